//! Frames of an MP4 or MOV file, decoded here while others are searched.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use anyhow::{Result, bail};
use grimnet_photo::{Metadata, Photo, PhotoLimits, QUERY_LONG_SIDE_PX, calendar};
use grimnet_video::{Video, VideoError, VideoFrame, VideoInfo};

use super::frame_time::Epoch;
use super::frames::{Frame, Frames};

/// Frames that are decoded ahead of the search.
const AHEAD: usize = 1;
/// How often a wait for a frame is interrupted to see whether the flight was stopped.
const POLL: Duration = Duration::from_millis(100);

/// See the module. Times count from the beginning of the video.
pub struct VideoFile {
    name: String,
    frames: Receiver<Frame>,
    count: usize,
    given: usize,
    ends_s: f64,
}

impl VideoFile {
    /// Starts decoding; `frames_per_s` frames are taken of each second.
    ///
    /// # Errors
    /// As [`Video::open`].
    pub fn open(path: &Path, frames_per_s: f64, limits: &PhotoLimits) -> Result<Self, VideoError> {
        let name = path.display().to_string();
        let video = Video::open(path, limits)?;
        tell(&name, video.info());
        let ends_s = video.info().shown_s.1;
        let decoded = video.at_rate(frames_per_s)?;
        let count = decoded.len();
        let (sender, frames) = sync_channel(AHEAD);
        // It ends with the video, or when nobody takes its frames any more.
        std::thread::spawn(move || {
            for (number, frame) in decoded.enumerate() {
                if sender.send(photo_of(number, frame)).is_err() {
                    return;
                }
            }
        });
        Ok(Self {
            name,
            frames,
            count,
            given: 0,
            ends_s,
        })
    }
}

/// What the file says of itself.
fn tell(name: &str, info: &VideoInfo) {
    let (width, height) = info.size_px;
    let (first_s, last_s) = info.shown_s;
    let created = info
        .created_unix_s
        .and_then(calendar::rfc3339)
        .map(|time| format!("; made at {time} by the camera's clock"))
        .unwrap_or_default();
    tracing::info!(
        "{name}: {}, {width} x {height} px, {} frames in {:.1} s{created}",
        info.codec,
        info.frames,
        last_s - first_s
    );
    if let Some((across, up)) = info.pixel_aspect {
        tracing::info!(
            "{name}: its pixels are not square ({across}:{up}); its pictures are stretched to square ones"
        );
    }
    if let Some(whole_s) = info.truncated_at_s {
        tracing::warn!(
            "{name} is truncated: it ends at {last_s:.1} s of {whole_s:.1} s, and its frames up to there are used; copy it again \
             from the camera for the others"
        );
    }
}

fn photo_of(number: usize, frame: VideoFrame) -> Frame {
    let name = format!("frame_{number:06}.jpg");
    let time_s = frame.time_s;
    match frame.picture {
        Ok(picture) => Frame {
            hash: blake3::hash(picture.as_raw()).to_hex().to_string(),
            photo: Ok(Photo::from_image_reduced(
                picture,
                Metadata::default(),
                QUERY_LONG_SIDE_PX,
            )),
            name,
            time_s,
        },
        Err(error) => Frame {
            name,
            time_s,
            hash: String::new(),
            photo: Err(error.into()),
        },
    }
}

impl Frames for VideoFile {
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>> {
        while !stop.load(Ordering::Relaxed) {
            match self.frames.recv_timeout(POLL) {
                Ok(frame) => {
                    self.given += 1;
                    return Ok(Some(frame));
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) if self.given < self.count => bail!(
                    "{}: decoding stopped after {} of {} frames",
                    self.name,
                    self.given,
                    self.count
                ),
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
            }
        }
        Ok(None)
    }

    fn epoch(&self) -> Epoch {
        Epoch::Start
    }

    fn count(&self) -> Option<usize> {
        Some(self.count)
    }

    fn ends_s(&self) -> Option<f64> {
        Some(self.ends_s)
    }
}
