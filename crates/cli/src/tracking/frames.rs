//! Frames of a flight, one after the other.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, Result};
use grimnet_answer::printable;
use grimnet_locate::NeededPixels;
use grimnet_photo::{Metadata, Photo, PhotoLimits, QUERY_LONG_SIDE_PX, read_photo_file};

use super::frame_time::{Epoch, FrameTime, TimeSource, frame_time};
use crate::{errors, inputs};

/// One frame.
pub struct Frame {
    /// Its name as it is written: the path as given, or a number.
    pub name: String,
    /// When it was exposed, seconds.
    pub time_s: f64,
    /// BLAKE3 of the file, as hexadecimal digits; empty if it could not be read.
    pub hash: String,
    /// The decoded photo; an error if it is damaged.
    pub photo: Result<Photo>,
}

/// Where frames come from.
pub trait Frames {
    /// The next frame; `None` at the end, and once `stop` is set.
    ///
    /// # Errors
    /// No frame can come any more.
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>>;

    /// What the times of the frames count from.
    fn epoch(&self) -> Epoch;

    /// Number of all frames, if it is known.
    fn count(&self) -> Option<usize> {
        None
    }

    /// When the last frame was taken, if it is known, seconds.
    fn ends_s(&self) -> Option<f64> {
        None
    }

    /// When the newest frame that waits to be taken was exposed, if one waits and that is known, seconds.
    fn newest_s(&self) -> Option<f64> {
        None
    }

    /// Whether the time of a frame so far is known to a second only.
    fn is_coarse(&self) -> bool {
        false
    }

    /// Frames that were left out because newer ones came while others were processed.
    fn dropped(&self) -> usize {
        0
    }

    /// Frames that were left out because they have no time.
    fn without_time(&self) -> usize {
        0
    }
}

/// How frames are read and get their times.
#[derive(Debug, Clone, Copy, Default)]
pub struct FrameOptions {
    /// From what the photo tells.
    pub source: TimeSource,
    /// Frames per second of frames that are numbered in order: overrides what photos tell.
    pub frames_per_s: Option<f64>,
    /// What is added to the times that photos tell, seconds.
    pub clock_offset_s: f64,
    /// Limits within which photos are read.
    pub limits: PhotoLimits,
    /// How many of their pixels are used; `None` if that is not known.
    pub needed: Option<NeededPixels>,
}

impl FrameOptions {
    /// The metadata of a photo file; none if it cannot be read, which its frame says.
    pub fn metadata_of(&self, path: &Path) -> Metadata {
        if inputs::check_regular(path).is_err() {
            return Metadata::default();
        }
        Metadata::read_within(path, &self.limits).unwrap_or_default()
    }

    /// The time of the photo file that is the frame `number`, counted from 0.
    ///
    /// # Errors
    /// Why it has none, in a line that names it.
    pub fn time_of_file(&self, number: usize, path: &Path) -> Result<FrameTime, String> {
        let metadata = if self.frames_per_s.is_some() {
            Metadata::default()
        } else {
            self.metadata_of(path)
        };
        self.time_of(number, &path.to_string_lossy(), &metadata)
            .ok_or_else(|| self.reason_without_time(&frame_from_file(path, 0.0, self), &metadata))
    }

    /// The time of the frame `number`, counted from 0.
    pub fn time_of(&self, number: usize, name: &str, metadata: &Metadata) -> Option<FrameTime> {
        match self.frames_per_s {
            Some(frames_per_s) => Some(FrameTime {
                time_s: number as f64 / frames_per_s,
                epoch: Epoch::Start,
                has_fraction: true,
            }),
            None => {
                let stated = frame_time(name, metadata.exposure_time, self.source)?;
                Some(FrameTime {
                    time_s: stated.time_s + self.clock_offset_s,
                    ..stated
                })
            }
        }
    }

    /// Why a frame has no time, in a line that names it: it cannot be read or decoded, its metadata are damaged, or what is asked for
    /// its time does not state it.
    pub fn reason_without_time(&self, frame: &Frame, metadata: &Metadata) -> String {
        let reason = match &frame.photo {
            Err(error) => errors::message_with_hint(error),
            Ok(_) => {
                let notes = metadata.notes.iter().map(|note| format!(" ({note})"));
                let silent = self.source.silent_text();
                format!("{silent}; {NO_TIME_HINT}{}", notes.collect::<String>())
            }
        };
        let line = format!("{}: left out: {reason}", frame.name);
        printable(&line).into_owned()
    }
}

/// What equal times of photos mean, and what to do about them, for messages.
pub const EQUAL_TIMES: &str = "of photos of one time the track takes in one, and nothing of the others; if the camera took photos \
    evenly, --fps N says how many a second";

/// What to do about a frame without time, for messages.
const NO_TIME_HINT: &str = "--fps N takes frames in order, N a second";

/// Reads and decodes a photo file as a frame.
pub fn frame_from_file(path: &Path, time_s: f64, options: &FrameOptions) -> Frame {
    let name = path.display().to_string();
    let read =
        inputs::check_regular(path).and_then(|()| Ok(read_photo_file(path, &options.limits)?));
    match read {
        Ok(bytes) => frame_from_bytes(name, time_s, &bytes, options),
        Err(error) => Frame {
            name,
            time_s,
            hash: String::new(),
            photo: Err(error),
        },
    }
}

/// Decodes the bytes of a photo as a frame.
pub fn frame_from_bytes(name: String, time_s: f64, bytes: &[u8], options: &FrameOptions) -> Frame {
    let limits = &options.limits;
    let photo = match options.needed {
        Some(needed) => needed.decode(&name, bytes, limits),
        None => Photo::from_bytes_within(&name, bytes, Some(QUERY_LONG_SIDE_PX), limits),
    };
    let photo = photo.context("the frame cannot be decoded");
    Frame {
        hash: blake3::hash(bytes).to_hex().to_string(),
        photo,
        name,
        time_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_is_added_to_the_times_that_photos_tell() {
        let options = FrameOptions {
            source: TimeSource::Name,
            clock_offset_s: -2.5,
            ..FrameOptions::default()
        };
        let of = |options: &FrameOptions| {
            let time = options.time_of(0, "20260621_100000.jpg", &Metadata::default());
            time.unwrap().time_s
        };
        assert_eq!(of(&options), 1_782_035_997.5);
        let numbered = FrameOptions {
            frames_per_s: Some(2.0),
            ..options
        };
        assert_eq!(of(&numbered), 0.0);
    }

    #[test]
    fn a_frame_without_time_is_told_where_it_was_looked_for() {
        let frame = Frame {
            name: "a.jpg".into(),
            time_s: 0.0,
            hash: String::new(),
            photo: Ok(Photo::from_image(
                image::RgbImage::new(8, 8),
                Metadata::default(),
            )),
        };
        for (source, expected) in [
            (TimeSource::Auto, "neither its EXIF data nor its name state"),
            (TimeSource::Exif, "--time-from exif asks its EXIF data only"),
            (TimeSource::Name, "--time-from name asks its name only"),
        ] {
            let options = FrameOptions {
                source,
                ..FrameOptions::default()
            };
            let line = options.reason_without_time(&frame, &Metadata::default());
            assert!(line.contains(expected), "{line}");
            assert!(line.contains("--fps N"), "{line}");
        }
    }
}
