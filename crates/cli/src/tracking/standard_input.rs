//! Frames of a stream, such as standard input: JPEG pictures one after the other, or lines with the names of photo files.

use std::io::{BufRead, Read as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use grimnet_output::OutputPolicy;
use grimnet_photo::Metadata;

use super::frame_time::Epoch;
use super::frames::{Frame, FrameOptions, Frames, frame_from_bytes, frame_from_file};
use super::handover::{Giver, Keep, Taker, handover};
use super::jpeg_stream::JpegStream;
use grimnet_answer::printable;

/// The first byte of a JPEG picture; no name begins with it in UTF-8.
const JPEG_BEGIN: u8 = 0xff;

/// How often a wait for the next frame looks whether it should stop.
const PATIENCE: Duration = Duration::from_millis(100);
const CANNOT_READ: &str = "cannot read standard input";
/// A line longer than this is no name, bytes (`PATH_MAX` of Linux).
const MOST_NAME_BYTES: usize = 4096;
/// After so many lines in a row that are no names nothing else is expected of the stream.
const MOST_GARBLED: usize = 20;
/// What begins like this is no text, though it need not have a NUL near its beginning: PNG, GIF, YUV4MPEG2.
const SIGNATURES: [&[u8]; 4] = [b"\x89PNG", b"GIF87a", b"GIF89a", b"YUV4MPEG2 "];
const NEITHER: &str = "standard input is neither JPEG pictures nor lines with names of photos; `ffmpeg -i INPUT -f image2pipe -c:v \
    mjpeg -` makes JPEG pictures of a video or of other pictures";

/// See the module. The first byte says which of the two it is.
pub struct StreamedFrames {
    /// From a thread that reads: a camera may be silent for long.
    input: Taker<Result<Streamed>>,
    options: FrameOptions,
    /// Gets every file that is named as an input.
    policy: OutputPolicy,
    epoch: Option<Epoch>,
    /// Whether a frame that can be read told the epoch.
    epoch_is_settled: bool,
    is_coarse: bool,
    without_time: usize,
}

/// A frame as it comes.
struct Streamed {
    /// Counted from 0, with those that are dropped.
    number: usize,
    content: Content,
}

/// What a stream holds.
enum Content {
    Picture(Vec<u8>),
    Name(PathBuf),
}

impl StreamedFrames {
    /// Reads on a thread of its own, from now on. `keep` says what becomes of a frame that waits while others come.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn new(
        input: impl BufRead + Send + 'static,
        options: FrameOptions,
        policy: OutputPolicy,
        keep: Keep,
        repeated: Repeated,
    ) -> Result<Self> {
        // Where all are kept, what comes while one waits and another is searched stays in the pipe.
        let (giver, taker) = handover();
        thread::Builder::new()
            .name("frames".to_owned())
            .spawn(move || read_all(input, &giver, keep, repeated))
            .context("cannot start a thread")?;
        Ok(Self {
            input: taker,
            options,
            policy,
            epoch: None,
            epoch_is_settled: false,
            is_coarse: false,
            without_time: 0,
        })
    }

    /// Whether a frame's time is on the clock of the frames before it. The first frame that can be read decides on it: names may be
    /// those of other files as well.
    fn is_on_clock(&mut self, epoch: Epoch, can_be_read: bool) -> bool {
        if !self.epoch_is_settled {
            self.epoch = Some(epoch);
            self.epoch_is_settled = can_be_read;
        }
        self.epoch == Some(epoch)
    }

    /// The next frame, with its number and the metadata that may tell its time. `None` at the end, and at once after `stop`.
    fn read(&mut self, stop: &AtomicBool) -> Result<Option<(usize, Frame, Metadata)>> {
        let Streamed { number, content } = loop {
            match self.input.take(PATIENCE) {
                Ok(next) => break next?,
                Err(RecvTimeoutError::Timeout) if !stop.load(Ordering::Relaxed) => {}
                Err(_) => return Ok(None),
            }
        };
        let options = &self.options;
        let (frame, metadata) = match content {
            Content::Picture(bytes) => {
                let name = format!("frame_{number:06}.jpg");
                let metadata = Metadata::from_bytes(&bytes);
                (frame_from_bytes(name, 0.0, &bytes, options), metadata)
            }
            Content::Name(path) => {
                self.policy.add_inputs([&path]);
                let frame = frame_from_file(&path, 0.0, options);
                (frame, options.metadata_of(&path))
            }
        };
        Ok(Some((number, frame, metadata)))
    }
}

/// Hands over what a stream holds, or why nothing can be read of it.
fn read_all(
    mut input: impl BufRead,
    giver: &Giver<Result<Streamed>>,
    keep: Keep,
    repeated: Repeated,
) {
    match holds_pictures(&mut input) {
        Ok(true) => {
            let mut stream = JpegStream::new(input);
            let next = || {
                let picture = stream.next_picture().context(CANNOT_READ)?;
                Ok(picture.map(Content::Picture))
            };
            give_all(next, giver, keep, repeated);
        }
        Ok(false) => {
            let mut names = Names::new(input);
            let next = || Ok(names.next()?.map(Content::Name));
            give_all(next, giver, keep, repeated);
        }
        Err(error) => {
            giver.give(Err(error), Keep::All);
        }
    }
}

/// Waits for the first byte: whether pictures or names follow.
fn holds_pictures(input: &mut impl BufRead) -> Result<bool> {
    let first = input.fill_buf().context(CANNOT_READ)?;
    Ok(first.first() == Some(&JPEG_BEGIN))
}

/// Which of the pictures in a row that are byte for byte the same is the frame. No two exposures have the same noise: `ffmpeg` repeats the
/// last picture at a constant rate where the video has none.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Repeated {
    /// The first, as it was taken then.
    First,
    /// Likewise, but at the beginning the last: `ffmpeg` repeats the first picture that it could decode from the time 0 on, as in a
    /// stream that begins between two key frames. Where the second one is repeated too, the first was shown for as long before it.
    LastOfTheBeginning,
}

/// Hands over what `next` gives until its end, an error, or nobody takes it. Repeated pictures are counted and left out.
fn give_all(
    mut next: impl FnMut() -> Result<Option<Content>>,
    giver: &Giver<Result<Streamed>>,
    keep: Keep,
    repeated: Repeated,
) {
    let mut last_picture = None;
    let mut most_held = match (repeated, keep) {
        (Repeated::First, _) => 0,
        // What comes while the aircraft flies does not wait for longer than it has to.
        (Repeated::LastOfTheBeginning, Keep::Newest) => 1,
        (Repeated::LastOfTheBeginning, Keep::All) => 2,
    };
    // The first pictures, until another one comes.
    let mut held: Vec<Streamed> = Vec::new();
    for number in 0.. {
        let found = next();
        if let Ok(Some(Content::Picture(bytes))) = &found {
            let hash = Some(blake3::hash(bytes));
            if std::mem::replace(&mut last_picture, hash) == hash {
                match held.as_mut_slice() {
                    [first] => first.number = number,
                    // Each is shown for so long: the video has fewer frames a second.
                    [first, _] => first.number = first.number.saturating_sub(1),
                    _ => {}
                }
                continue;
            }
        }
        let is_held = held.len() < most_held && matches!(found, Ok(Some(_)));
        if !is_held {
            most_held = 0;
            for streamed in held.drain(..) {
                if !giver.give(Ok(streamed), keep) {
                    return;
                }
            }
        }
        let content = match found {
            Ok(Some(content)) => content,
            Ok(None) => return,
            // The frame before it is still of use.
            Err(error) => {
                giver.give(Err(error), Keep::All);
                return;
            }
        };
        let streamed = Streamed { number, content };
        if is_held {
            held.push(streamed);
        } else if !giver.give(Ok(streamed), keep) {
            return;
        }
    }
}

/// The names in the lines of a stream.
struct Names<R> {
    input: R,
    /// Lines that were read.
    lines: u64,
    /// Lines in a row that were no names. `None` before the first name: what begins with such a line is something else.
    garbled: Option<usize>,
}

impl<R: BufRead> Names<R> {
    fn new(input: R) -> Self {
        Self {
            input,
            lines: 0,
            garbled: None,
        }
    }

    /// The name in the next line that is not empty; `None` at the end. One that is not UTF-8 is the name of no photo. After the first
    /// name a line that was damaged on its way is left out, with a warning.
    ///
    /// # Errors
    /// It cannot be read, or is no text.
    fn next(&mut self) -> Result<Option<PathBuf>> {
        loop {
            let mut line = Vec::new();
            if read_limited(&mut self.input, &mut line)? == 0 {
                return Ok(None);
            }
            self.lines += 1;
            if line.len() > MOST_NAME_BYTES || !is_text(&line) {
                let garbled = self.garbled.as_mut();
                let Some(garbled) = garbled.filter(|garbled| **garbled < MOST_GARBLED) else {
                    bail!(NEITHER);
                };
                *garbled += 1;
                tracing::warn!("standard input, line {}: left out: no name", self.lines);
                while !line.ends_with(b"\n") {
                    line.clear();
                    if read_limited(&mut self.input, &mut line)? == 0 {
                        return Ok(None);
                    }
                }
                continue;
            }
            let line = String::from_utf8_lossy(&line);
            let name = line.trim();
            if !name.is_empty() {
                self.garbled = Some(0);
                return Ok(Some(PathBuf::from(name)));
            }
        }
    }
}

/// Reads a line, or one byte more of it than a name has. Gives the bytes that were read.
fn read_limited(input: &mut impl BufRead, line: &mut Vec<u8>) -> Result<usize> {
    let mut limited = input.take(MOST_NAME_BYTES as u64 + 1);
    limited.read_until(b'\n', line).context(CANNOT_READ)
}

/// Whether bytes of a stream may be lines with names, and not those of pictures or videos.
fn is_text(bytes: &[u8]) -> bool {
    let begins_with = |signature: &&[u8]| bytes.starts_with(signature);
    !bytes.contains(&0) && !SIGNATURES.iter().any(begins_with)
}

impl Frames for StreamedFrames {
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>> {
        while !stop.load(Ordering::Relaxed) {
            let Some((number, mut frame, metadata)) = self.read(stop)? else {
                break;
            };
            match self.options.time_of(number, &frame.name, &metadata) {
                Some(time) if self.is_on_clock(time.epoch, frame.photo.is_ok()) => {
                    frame.time_s = time.time_s;
                    self.is_coarse |= !time.has_fraction;
                    return Ok(Some(frame));
                }
                Some(_) => tracing::warn!(
                    "{}: left out: its time is not on the clock of the photos before it",
                    printable(&frame.name)
                ),
                None => tracing::warn!("{}", self.options.reason_without_time(&frame, &metadata)),
            }
            self.without_time += 1;
        }
        Ok(None)
    }

    fn epoch(&self) -> Epoch {
        self.epoch.unwrap_or(Epoch::Start)
    }

    fn is_coarse(&self) -> bool {
        self.is_coarse
    }

    fn dropped(&self) -> usize {
        self.input.dropped()
    }

    fn without_time(&self) -> usize {
        self.without_time
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;

    #[test]
    fn names_are_read_line_by_line() {
        let options = FrameOptions::default();
        let text = "gone_1.5.jpg\n\nno time.jpg\n  gone_2.0.jpg";
        let policy = OutputPolicy::new();
        let mut frames =
            StreamedFrames::new(text.as_bytes(), options, policy, Keep::All, Repeated::First)
                .unwrap();
        let stop = AtomicBool::new(false);
        let mut next = || frames.next(&stop).unwrap();
        let first = next().unwrap();
        assert_eq!((first.name.as_str(), first.time_s), ("gone_1.5.jpg", 1.5));
        assert!(first.photo.is_err());
        assert_eq!(next().unwrap().time_s, 2.0);
        assert!(next().is_none());
        assert_eq!(frames.without_time(), 1);
    }

    /// Such as `ls` names, with a text beside the photos.
    #[test]
    fn a_name_that_is_no_photos_does_not_decide_on_the_clock() {
        let folder = tempfile::tempdir().unwrap();
        let photo = folder.path().join("20260621_100000_500.png");
        image::RgbImage::new(64, 48).save(&photo).unwrap();
        let text = format!("calibration_1.0.txt\n{}\ngone_2.5.jpg\n", photo.display());
        let (input, policy) = (io::Cursor::new(text), OutputPolicy::new());
        let options = FrameOptions::default();
        let mut frames =
            StreamedFrames::new(input, options, policy, Keep::All, Repeated::First).unwrap();
        let stop = AtomicBool::new(false);
        let first = frames.next(&stop).unwrap().unwrap();
        assert_eq!((first.time_s, frames.epoch()), (1.0, Epoch::Start));
        let second = frames.next(&stop).unwrap().unwrap();
        assert!(second.photo.is_ok());
        assert_eq!(frames.epoch(), Epoch::Unix);
        assert!(frames.next(&stop).unwrap().is_none());
        assert_eq!(frames.without_time(), 1);
    }

    /// Such as `ffmpeg` writes a video with gaps, or of fewer frames a second, at a constant rate.
    #[test]
    fn a_picture_that_is_repeated_is_one_frame_at_the_time_of_the_first() {
        let jpeg = |grey: u8| {
            let picture = image::RgbImage::from_pixel(64, 48, image::Rgb([grey; 3]));
            let mut bytes = io::Cursor::new(Vec::new());
            picture
                .write_to(&mut bytes, image::ImageFormat::Jpeg)
                .unwrap();
            bytes.into_inner()
        };
        let options = FrameOptions {
            frames_per_s: Some(2.0),
            ..FrameOptions::default()
        };
        let stream = [10, 10, 80, 80, 80, 160, 10].map(jpeg).concat();
        let (input, policy) = (io::Cursor::new(stream), OutputPolicy::new());
        let mut frames =
            StreamedFrames::new(input, options, policy, Keep::All, Repeated::First).unwrap();
        let go_on = AtomicBool::new(false);
        let times_s = std::iter::from_fn(|| Some(frames.next(&go_on).unwrap()?.time_s));
        assert_eq!(Vec::from_iter(times_s), [0.0, 1.0, 2.5, 3.0]);
    }

    /// Such as by a cable.
    #[test]
    fn lines_that_were_damaged_do_not_end_a_flight_that_has_names() {
        let long = vec![b'x'; 3 * MOST_NAME_BYTES];
        let too_long_by_its_end = vec![b'y'; MOST_NAME_BYTES];
        let lines = |garbled: usize| {
            let mut bytes = b"a_1.5.jpg\n".to_vec();
            for number in 0..garbled {
                let damaged: [&[u8]; 4] = [b"b_\0.jpg", &long, b"\x89PNG", &too_long_by_its_end];
                bytes.extend_from_slice(damaged[number % 4]);
                bytes.push(b'\n');
            }
            bytes.extend_from_slice(b"c_2.5.jpg\n");
            bytes
        };
        let names = |bytes: Vec<u8>| {
            let mut names = Names::new(&bytes[..]);
            std::iter::from_fn(|| names.next().transpose()).collect::<Result<Vec<PathBuf>>>()
        };
        let expected = ["a_1.5.jpg", "c_2.5.jpg"].map(PathBuf::from);
        assert_eq!(names(lines(MOST_GARBLED)).unwrap(), expected);
        let error = names(lines(MOST_GARBLED + 1)).unwrap_err();
        assert_eq!(error.to_string(), NEITHER);
    }

    #[test]
    fn a_damaged_line_that_comes_with_the_first_name_is_left_out_too() {
        let text = "gone_1.5.jpg\n\0\ngone_2.0.jpg\n";
        let (options, policy) = (FrameOptions::default(), OutputPolicy::new());
        let mut frames =
            StreamedFrames::new(text.as_bytes(), options, policy, Keep::All, Repeated::First)
                .unwrap();
        let go_on = AtomicBool::new(false);
        let times_s = std::iter::from_fn(|| Some(frames.next(&go_on).unwrap()?.time_s));
        assert_eq!(Vec::from_iter(times_s), [1.5, 2.0]);
    }

    #[test]
    fn what_is_neither_pictures_nor_names_is_refused_once() {
        let long = [b'a'; MOST_NAME_BYTES + 1];
        let png = *b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR";
        let names_apart_by_nul = b"a_1.5.jpg\0a_2.5.jpg\0";
        for bytes in [
            &long[..],
            &png,
            names_apart_by_nul,
            b"YUV4MPEG2 W640 H480\nFRAME\n",
        ] {
            // Whatever comes with the first bytes.
            for first in [1, 5, bytes.len()] {
                let (first, rest) = bytes.split_at(first);
                let [first, rest] = [first, rest].map(|part| io::Cursor::new(part.to_vec()));
                let input = io::BufReader::new(first.chain(rest));
                let error = refusal(input.chain(&b"\nb_1.5.jpg\n"[..]));
                assert!(error.starts_with("standard input is neither"), "{error}");
            }
        }
    }

    /// The error before the first frame.
    fn refusal(input: impl BufRead + Send + 'static) -> String {
        let (options, policy) = (FrameOptions::default(), OutputPolicy::new());
        let next = StreamedFrames::new(input, options, policy, Keep::All, Repeated::First)
            .and_then(|mut frames| frames.next(&AtomicBool::new(false)));
        next.err().expect("it is refused").to_string()
    }

    /// A camera that gives nothing for ever.
    struct Silent;

    impl io::Read for Silent {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            loop {
                thread::park();
            }
        }
    }

    #[test]
    fn a_silent_camera_does_not_keep_it_from_stopping() {
        for first in [&b""[..], b"n"] {
            let options = FrameOptions::default();
            let input = io::BufReader::new(first.chain(Silent));
            let policy = OutputPolicy::new();
            let mut frames =
                StreamedFrames::new(input, options, policy, Keep::All, Repeated::First).unwrap();
            let stop = std::sync::Arc::new(AtomicBool::new(false));
            let later = stop.clone();
            thread::spawn(move || {
                thread::sleep(2 * PATIENCE);
                later.store(true, Ordering::Relaxed);
            });
            assert!(frames.next(&stop).unwrap().is_none());
        }
    }

    /// The numbers of the frames among these pictures, which are named by a byte each.
    fn numbers(pictures: &'static [u8], repeated: Repeated) -> Vec<usize> {
        let (giver, taker) = handover();
        let mut pictures = pictures.iter();
        let next = move || Ok(pictures.next().map(|byte| Content::Picture(vec![*byte])));
        let thread = thread::spawn(move || give_all(next, &giver, Keep::All, repeated));
        let mut numbers = Vec::new();
        while let Ok(frame) = taker.take(PATIENCE) {
            numbers.push(frame.unwrap().number);
        }
        thread.join().unwrap();
        numbers
    }

    #[test]
    fn a_repeated_picture_is_one_frame_and_the_first_one_counts_when_it_ends() {
        assert_eq!(numbers(b"AAABBC", Repeated::First), [0, 3, 5]);
        let padded = Repeated::LastOfTheBeginning;
        assert_eq!(numbers(b"AAABC", padded), [2, 3, 4]);
        assert_eq!(numbers(b"ABBC", padded), [0, 1, 3]);
        assert_eq!(numbers(b"AA", padded), [1]);
        // Of a video with a frame in each third of the pictures, from its beginning and from later on.
        assert_eq!(numbers(b"AAABBBCCC", padded), [0, 3, 6]);
        assert_eq!(numbers(b"AAAAABBBCCC", padded), [2, 5, 8]);
        assert_eq!(numbers(b"AAABBB", padded), [0, 3]);
    }
}
