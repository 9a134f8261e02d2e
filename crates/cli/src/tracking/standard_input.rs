//! Frames of a stream, such as standard input: JPEG pictures one after the other, or lines with the names of photo files.

use std::io::{self, BufRead, Read as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, Result};
use grimnet_output::OutputPolicy;
use grimnet_photo::Metadata;

use super::frame_time::Epoch;
use super::frames::{
    Frame, FrameOptions, Frames, frame_from_bytes, frame_from_file, reason_without_time,
};
use super::handover::{Giver, Keep, Taker, handover};
use super::jpeg_stream::JpegStream;
use grimnet_answer::printable;

/// The first byte of a JPEG picture; no name begins with it in UTF-8.
const JPEG_BEGIN: u8 = 0xff;

/// How often a wait for the next frame looks whether it should stop.
const PATIENCE: Duration = Duration::from_millis(100);
const CANNOT_READ: &str = "cannot read standard input";
/// A line longer than this is no name, bytes.
const MOST_NAME_BYTES: u64 = 64 << 10;

/// See the module. The first byte says which of the two it is.
pub struct StreamedFrames {
    /// From a thread that reads: a camera may be silent for long.
    input: Taker<io::Result<Streamed>>,
    options: FrameOptions,
    /// Gets every file that is named as an input.
    policy: OutputPolicy,
    epoch: Option<Epoch>,
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
    /// Waits for the first byte. `keep` says what becomes of a frame that waits while others come.
    ///
    /// # Errors
    /// Nothing can be read, or no thread can be started.
    pub fn new(
        mut input: impl BufRead + Send + 'static,
        options: FrameOptions,
        policy: OutputPolicy,
        keep: Keep,
    ) -> Result<Self> {
        let first = input.fill_buf().context(CANNOT_READ)?;
        let holds_pictures = first.first() == Some(&JPEG_BEGIN);
        // Where all are kept, what comes while one waits and another is searched stays in the pipe.
        let (giver, taker) = handover();
        let read = move || {
            if holds_pictures {
                let mut stream = JpegStream::new(input);
                let next = || Ok(stream.next_picture()?.map(Content::Picture));
                give_all(next, &giver, keep);
            } else {
                let next = || Ok(next_name(&mut input)?.map(Content::Name));
                give_all(next, &giver, keep);
            }
        };
        thread::Builder::new()
            .name("frames".to_owned())
            .spawn(read)
            .context("cannot start a thread")?;
        Ok(Self {
            input: taker,
            options,
            policy,
            epoch: None,
            is_coarse: false,
            without_time: 0,
        })
    }

    /// The next frame, with its number and the metadata that may tell its time. `None` at the end, and at once after `stop`.
    fn read(&mut self, stop: &AtomicBool) -> Result<Option<(usize, Frame, Metadata)>> {
        let Streamed { number, content } = loop {
            match self.input.take(PATIENCE) {
                Ok(next) => break next.context(CANNOT_READ)?,
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

/// Hands over what `next` gives until its end, an error, or nobody takes it.
fn give_all(
    mut next: impl FnMut() -> io::Result<Option<Content>>,
    giver: &Giver<io::Result<Streamed>>,
    keep: Keep,
) {
    for number in 0.. {
        let given = match next() {
            Ok(None) => return,
            Ok(Some(content)) => giver.give(Ok(Streamed { number, content }), keep),
            // The frame before it is still of use.
            Err(error) => {
                giver.give(Err(error), Keep::All);
                return;
            }
        };
        if !given {
            return;
        }
    }
}

/// The name in the next line that is not empty; `None` at the end. One that is not UTF-8 is the name of no photo.
fn next_name(input: &mut impl BufRead) -> io::Result<Option<PathBuf>> {
    loop {
        let mut line = Vec::new();
        let mut limited = input.by_ref().take(MOST_NAME_BYTES);
        if limited.read_until(b'\n', &mut line)? == 0 {
            return Ok(None);
        }
        let line = String::from_utf8_lossy(&line);
        let name = line.trim();
        if !name.is_empty() {
            return Ok(Some(PathBuf::from(name)));
        }
    }
}

impl Frames for StreamedFrames {
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>> {
        while !stop.load(Ordering::Relaxed) {
            let Some((number, mut frame, metadata)) = self.read(stop)? else {
                break;
            };
            match self.options.time_of(number, &frame.name, &metadata) {
                Some(time) if *self.epoch.get_or_insert(time.epoch) == time.epoch => {
                    frame.time_s = time.time_s;
                    self.is_coarse |= !time.has_fraction;
                    return Ok(Some(frame));
                }
                Some(_) => tracing::warn!(
                    "{}: left out: its time is not on the clock of the photos before it",
                    printable(&frame.name)
                ),
                None => tracing::warn!("{}", reason_without_time(&frame, &metadata)),
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

    #[test]
    fn names_are_read_line_by_line() {
        let options = FrameOptions::default();
        let text = "gone_1.5.jpg\n\nno time.jpg\n  gone_2.0.jpg";
        let policy = OutputPolicy::new();
        let mut frames = StreamedFrames::new(text.as_bytes(), options, policy, Keep::All).unwrap();
        let stop = AtomicBool::new(false);
        let mut next = || frames.next(&stop).unwrap();
        let first = next().unwrap();
        assert_eq!((first.name.as_str(), first.time_s), ("gone_1.5.jpg", 1.5));
        assert!(first.photo.is_err());
        assert_eq!(next().unwrap().time_s, 2.0);
        assert!(next().is_none());
        assert_eq!(frames.without_time(), 1);
    }

    /// A camera that gave one byte, and then nothing for ever.
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
        let options = FrameOptions::default();
        let input = io::BufReader::new((&b"n"[..]).chain(Silent));
        let policy = OutputPolicy::new();
        let mut frames = StreamedFrames::new(input, options, policy, Keep::All).unwrap();
        let stop = std::sync::Arc::new(AtomicBool::new(false));
        let later = stop.clone();
        thread::spawn(move || {
            thread::sleep(2 * PATIENCE);
            later.store(true, Ordering::Relaxed);
        });
        assert!(frames.next(&stop).unwrap().is_none());
    }
}
