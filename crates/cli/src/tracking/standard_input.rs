//! Frames on standard input: JPEG pictures one after the other, or lines with the names of photo files.

use std::io::{self, BufRead, Read as _};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, Result};
use grimnet_output::OutputPolicy;
use grimnet_photo::Metadata;

use super::frame_time::Epoch;
use super::frames::{
    Frame, FrameOptions, Frames, frame_from_bytes, frame_from_file, reason_without_time,
};
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
    input: Receiver<io::Result<Streamed>>,
    options: FrameOptions,
    /// Gets every file that is named as an input.
    policy: OutputPolicy,
    epoch: Option<Epoch>,
    is_coarse: bool,
    number: usize,
    without_time: usize,
}

/// What a stream holds.
enum Streamed {
    Picture(Vec<u8>),
    Name(PathBuf),
}

impl StreamedFrames {
    /// Waits for the first byte.
    ///
    /// # Errors
    /// Nothing can be read, or no thread can be started.
    pub fn new(
        mut input: impl BufRead + Send + 'static,
        options: FrameOptions,
        policy: OutputPolicy,
    ) -> Result<Self> {
        let first = input.fill_buf().context(CANNOT_READ)?;
        let holds_pictures = first.first() == Some(&JPEG_BEGIN);
        // One picture is read while another is searched; what comes then waits in the pipe.
        let (sender, receiver) = sync_channel(0);
        let read = move || {
            if holds_pictures {
                let mut stream = JpegStream::new(input);
                send_all(
                    || Ok(stream.next_picture()?.map(Streamed::Picture)),
                    &sender,
                );
            } else {
                send_all(|| Ok(next_name(&mut input)?.map(Streamed::Name)), &sender);
            }
        };
        thread::Builder::new()
            .name("frames".to_owned())
            .spawn(read)
            .context("cannot start a thread")?;
        Ok(Self {
            input: receiver,
            options,
            policy,
            epoch: None,
            is_coarse: false,
            number: 0,
            without_time: 0,
        })
    }

    /// The next frame, with the metadata that may tell its time. `None` at the end, and at once after `stop`.
    fn read(&mut self, stop: &AtomicBool) -> Result<Option<(Frame, Metadata)>> {
        let next = loop {
            match self.input.recv_timeout(PATIENCE) {
                Ok(next) => break next.context(CANNOT_READ)?,
                Err(RecvTimeoutError::Timeout) if !stop.load(Ordering::Relaxed) => {}
                Err(_) => return Ok(None),
            }
        };
        let options = &self.options;
        Ok(Some(match next {
            Streamed::Picture(bytes) => {
                let name = format!("frame_{:06}.jpg", self.number);
                let metadata = Metadata::from_bytes(&bytes);
                (frame_from_bytes(name, 0.0, &bytes, options), metadata)
            }
            Streamed::Name(path) => {
                self.policy.add_inputs([&path]);
                let frame = frame_from_file(&path, 0.0, options);
                (frame, options.metadata_of(&path))
            }
        }))
    }
}

/// Sends what `next` gives until its end, an error, or nobody listens.
fn send_all<T>(
    mut next: impl FnMut() -> io::Result<Option<T>>,
    sender: &SyncSender<io::Result<T>>,
) {
    while let Some(sent) = next().transpose() {
        let is_last = sent.is_err();
        if sender.send(sent).is_err() || is_last {
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
            let Some((mut frame, metadata)) = self.read(stop)? else {
                break;
            };
            let time = self.options.time_of(self.number, &frame.name, &metadata);
            self.number += 1;
            match time {
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
        let mut frames = StreamedFrames::new(text.as_bytes(), options, policy).unwrap();
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
        let mut frames = StreamedFrames::new(input, options, OutputPolicy::new()).unwrap();
        let stop = std::sync::Arc::new(AtomicBool::new(false));
        let later = stop.clone();
        thread::spawn(move || {
            thread::sleep(2 * PATIENCE);
            later.store(true, Ordering::Relaxed);
        });
        assert!(frames.next(&stop).unwrap().is_none());
    }
}
