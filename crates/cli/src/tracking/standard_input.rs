//! Frames on standard input: JPEG pictures one after the other, or lines with the names of photo files.

use std::io::{BufRead, Read as _};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

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

/// See the module. The first byte says which of the two it is.
pub struct StreamedFrames<R> {
    input: Input<R>,
    options: FrameOptions,
    /// Gets every file that is named as an input.
    policy: OutputPolicy,
    epoch: Option<Epoch>,
    is_coarse: bool,
    number: usize,
    without_time: usize,
}

enum Input<R> {
    Pictures(JpegStream<R>),
    Names(R),
}

impl<R: BufRead> StreamedFrames<R> {
    /// Waits for the first byte.
    ///
    /// # Errors
    /// Nothing can be read.
    pub fn new(mut input: R, options: FrameOptions, policy: OutputPolicy) -> Result<Self> {
        let first = input.fill_buf().context("cannot read standard input")?;
        let input = if first.first() == Some(&JPEG_BEGIN) {
            Input::Pictures(JpegStream::new(input))
        } else {
            Input::Names(input)
        };
        Ok(Self {
            input,
            options,
            policy,
            epoch: None,
            is_coarse: false,
            number: 0,
            without_time: 0,
        })
    }

    /// The next frame, with the metadata that may tell its time. `None` at the end.
    fn read(&mut self) -> Result<Option<(Frame, Metadata)>> {
        let options = &self.options;
        match &mut self.input {
            Input::Pictures(stream) => {
                let picture = stream
                    .next_picture()
                    .context("cannot read standard input")?;
                Ok(picture.map(|bytes| {
                    let name = format!("frame_{:06}.jpg", self.number);
                    let metadata = Metadata::from_bytes(&bytes);
                    (frame_from_bytes(name, 0.0, &bytes, options), metadata)
                }))
            }
            Input::Names(input) => {
                let mut line = String::new();
                loop {
                    line.clear();
                    // A line that does not end is no name.
                    let count = input
                        .by_ref()
                        .take(64 << 10)
                        .read_line(&mut line)
                        .context("cannot read names of photos from standard input")?;
                    if count == 0 {
                        return Ok(None);
                    }
                    let name = line.trim();
                    if !name.is_empty() {
                        let path = Path::new(name);
                        self.policy.add_inputs([path]);
                        let frame = frame_from_file(path, 0.0, options);
                        return Ok(Some((frame, options.metadata_of(path))));
                    }
                }
            }
        }
    }
}

impl<R: BufRead> Frames for StreamedFrames<R> {
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>> {
        while !stop.load(Ordering::Relaxed) {
            let Some((mut frame, metadata)) = self.read()? else {
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
    use super::super::frame_time::TimeSource;
    use super::*;
    use grimnet_photo::PhotoLimits;

    #[test]
    fn names_are_read_line_by_line() {
        let options = FrameOptions {
            source: TimeSource::Auto,
            frames_per_s: None,
            clock_offset_s: 0.0,
            limits: PhotoLimits::DEFAULT,
            needed: None,
        };
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
}
