//! Frames of a video, decoded by an `ffmpeg` process: of any kind that it reads, and from addresses.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, Result, bail};
use grimnet_answer::printable;
use grimnet_link::LONGEST_STREAM_GAP_S;
use grimnet_output::OutputPolicy;
use grimnet_photo::PhotoLimits;

use super::frame_time::Epoch;
use super::frames::{Frame, FrameOptions, Frames};
use super::handover::Keep;
use super::standard_input::{Repeated, StreamedFrames};

/// How `fps` rounds a picture's time to one of the rate. It gives the last picture of those with the same rounded time: rounded up, that
/// is the one shown then, to the nearest the one shown almost half an interval later.
const ROUND: &str = "up";
/// The filter that stretches pictures to square pixels, as those of [`grimnet_video`] are; square ones stay as they are.
const SQUARE_PIXELS: &str = "scale='iw*clip(sar,1,4)':'ih*clip(1/sar,1,4)',setsar=1";

/// What `ffmpeg` reads of a live stream before it gives a frame: by default it reads 5 MB or for 5 s, and of a slow H.265 stream for 12 s.
/// The dimensions may come later, with the first key frame.
const PROBED_OF_STREAM: [&str; 4] = ["-probesize", "100000", "-analyzeduration", "1000000"];

/// See the module. Times count from the beginning of the video.
pub struct FfmpegVideo {
    ffmpeg: Child,
    frames: StreamedFrames,
    name: String,
    given: usize,
}

impl FfmpegVideo {
    /// Starts decoding; `frames_per_s` frames are taken of each second, and `keep` says what becomes of one that waits while others
    /// come.
    ///
    /// # Errors
    /// There is no `ffmpeg` on the PATH.
    pub fn open(source: &Path, frames_per_s: f64, limits: PhotoLimits, keep: Keep) -> Result<Self> {
        let given = source.display().to_string();
        let name = without_password(&given);
        let probed: &[&str] = match keep {
            Keep::Newest => &PROBED_OF_STREAM,
            Keep::All => &[],
        };
        let mut ffmpeg = Command::new("ffmpeg")
            .args(["-hide_banner", "-loglevel", "error", "-nostdin"])
            .args(probed)
            // Else it takes every gap above 10 s out of the times of a transport stream.
            .arg("-dts_delta_threshold")
            .arg(LONGEST_STREAM_GAP_S.to_string())
            .arg("-i")
            .arg(input(source))
            .args(["-map", "0:v:0", "-vf"])
            .arg(format!(
                "fps={frames_per_s}:start_time=0:round={ROUND},{SQUARE_PIXELS}"
            ))
            // With several threads its encoder gives a picture only when later ones have come, a second late at 2 frames a second.
            .args(["-f", "image2pipe", "-c:v", "mjpeg", "-threads", "1"])
            .args(["-q:v", "2", "-"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| {
                format!(
                    "{name}: a video of this kind is decoded by the program `ffmpeg`, which could not be started; install it, or \
                     save the video's frames as photos"
                )
            })?;
        let Some(output) = ffmpeg.stdout.take() else {
            bail!("{name}: ffmpeg has no output");
        };
        if let Some(messages) = ffmpeg.stderr.take() {
            let shown = name.clone();
            // It ends with `ffmpeg`.
            std::thread::spawn(move || {
                for line in BufReader::new(messages).split(b'\n').map_while(Result::ok) {
                    let line = String::from_utf8_lossy(&line).replace(&given, &shown);
                    tracing::warn!("ffmpeg: {}", printable(line.trim_end()));
                }
            });
        }
        let options = FrameOptions {
            frames_per_s: Some(frames_per_s),
            limits,
            ..FrameOptions::default()
        };
        // Pictures alone come from there, no names of files.
        let policy = OutputPolicy::new();
        Ok(Self {
            ffmpeg,
            frames: StreamedFrames::new(
                BufReader::new(output),
                options,
                policy,
                keep,
                Repeated::LastOfTheBeginning,
            )?,
            name,
            given: 0,
        })
    }
}

/// Whether a source is an address, and not the name of a file.
pub fn is_address(source: &Path) -> bool {
    source.to_string_lossy().contains("://")
}

/// An address without the password that it may hold, for messages and files: `rtsp://user:***@10.0.0.2/stream`.
fn without_password(address: &str) -> String {
    let hidden = || {
        let (protocol, rest) = address.split_once("://")?;
        let authority = rest.split(['/', '?', '#']).next()?;
        let (user_info, _) = authority.rsplit_once('@')?;
        let (user, _) = user_info.split_once(':')?;
        let after = &rest[user_info.len()..];
        Some(format!("{protocol}://{user}:***{after}"))
    };
    hidden().unwrap_or_else(|| address.to_owned())
}

/// A source as `ffmpeg` takes it: what stands before a colon in the name of a file would be a protocol.
fn input(source: &Path) -> OsString {
    let mut input = OsString::new();
    if !is_address(source) {
        input.push("file:");
    }
    input.push(source);
    input
}

impl Frames for FfmpegVideo {
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>> {
        let next = self.frames.next(stop)?;
        if next.is_none() && !stop.load(std::sync::atomic::Ordering::Relaxed) {
            let status = self.ffmpeg.wait()?;
            if self.given == 0 {
                bail!("{}: ffmpeg gave no frame ({status})", self.name);
            }
            if !status.success() {
                tracing::warn!(
                    "{}: ffmpeg ended with {status} after {} frames; is the video truncated?",
                    self.name,
                    self.given
                );
            }
        }
        self.given += usize::from(next.is_some());
        Ok(next)
    }

    fn epoch(&self) -> Epoch {
        Epoch::Start
    }

    fn dropped(&self) -> usize {
        self.frames.dropped()
    }
}

impl Drop for FfmpegVideo {
    fn drop(&mut self) {
        // It has ended already, or nobody reads its output any more.
        let _ = self.ffmpeg.kill();
        let _ = self.ffmpeg.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_in_an_address_is_not_shown() {
        for (address, shown) in [
            ("rtsp://10.0.0.2/stream", "rtsp://10.0.0.2/stream"),
            ("rtsp://me@10.0.0.2/a:b@c", "rtsp://me@10.0.0.2/a:b@c"),
            (
                "rtsp://me:p@ss:1@10.0.0.2:554/a",
                "rtsp://me:***@10.0.0.2:554/a",
            ),
            ("rtsp://me:secret@cam?x=1", "rtsp://me:***@cam?x=1"),
            ("flight.mkv", "flight.mkv"),
        ] {
            assert_eq!(without_password(address), shown);
        }
    }
}
