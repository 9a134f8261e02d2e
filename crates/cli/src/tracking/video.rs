//! A video as frames: decoded here if it can be, else by an `ffmpeg` process.

use std::path::Path;

use anyhow::Result;
use grimnet_photo::PhotoLimits;

use super::ffmpeg::{FfmpegVideo, is_address};
use super::frames::Frames;
use super::handover::Keep;
#[cfg(feature = "video")]
use super::video_file::VideoFile;

/// Endings of video files, lower case.
const VIDEO_ENDINGS: &[&str] = &[
    "mp4", "mov", "m4v", "mkv", "avi", "ts", "m2ts", "mts", "mpg", "mpeg", "webm", "h264", "h265",
];
/// Endings of those that are read here.
#[cfg(feature = "video")]
const BUILT_IN_ENDINGS: &[&str] = &["mp4", "mov", "m4v"];
/// Protocols that give whole files: a recorded video, if the address has the ending of one.
const FILE_PROTOCOLS: &[&str] = &["file", "http", "https", "ftp", "sftp"];
/// Frames per second that are taken from a video if nothing else is asked for.
pub const DEFAULT_FRAMES_PER_S: f64 = 2.0;

/// Whether a source is a video: by its ending, or an address such as `rtsp://`.
pub fn is_video(source: &Path) -> bool {
    is_address(source) || has_ending(source, VIDEO_ENDINGS)
}

/// Whether a source is an address at which a camera is heard while it flies: any but those of video files.
pub fn is_live_address(source: &Path) -> bool {
    let text = source.to_string_lossy();
    let Some((protocol, rest)) = text.split_once("://") else {
        return false;
    };
    let path = rest.split(['?', '#']).next().unwrap_or_default();
    let is_file = has_ending(Path::new(path), VIDEO_ENDINGS);
    !(is_file && FILE_PROTOCOLS.contains(&protocol.to_lowercase().as_str()))
}

/// Whether a file's name ends so, in upper or lower case.
pub fn has_ending(source: &Path, endings: &[&str]) -> bool {
    let ending = source
        .extension()
        .map(|e| e.to_string_lossy().to_lowercase());
    ending.is_some_and(|ending| endings.contains(&ending.as_str()))
}

/// Opens a recorded video; `frames_per_s` frames are taken of each second.
///
/// # Errors
/// It cannot be read, or it needs an `ffmpeg` that is not there.
pub fn open_video(
    source: &Path,
    frames_per_s: f64,
    limits: PhotoLimits,
) -> Result<Box<dyn Frames>> {
    if !is_address(source) {
        crate::inputs::check_regular(source)?;
    }
    #[cfg(feature = "video")]
    if !is_address(source) && has_ending(source, BUILT_IN_ENDINGS) {
        match VideoFile::open(source, frames_per_s, &limits) {
            Ok(video) => return Ok(Box::new(video)),
            Err(error) if error.is_unsupported() => {
                let video = FfmpegVideo::open(source, frames_per_s, limits, Keep::All)
                    .map_err(|ffmpeg| ffmpeg.context(error.to_string()))?;
                tracing::info!("{error}; ffmpeg decodes it");
                return Ok(Box::new(video));
            }
            Err(error) => return Err(error.into()),
        }
    }
    let video = FfmpegVideo::open(source, frames_per_s, limits, Keep::All)?;
    Ok(Box::new(video))
}

/// Opens a live stream, of which the newest frame is taken; the others are dropped.
///
/// # Errors
/// It cannot be read, or there is no `ffmpeg`.
pub fn open_stream(
    address: &Path,
    frames_per_s: f64,
    limits: PhotoLimits,
) -> Result<Box<dyn Frames>> {
    let video = FfmpegVideo::open(address, frames_per_s, limits, Keep::Newest)?;
    Ok(Box::new(video))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn videos_are_known_by_their_ending_or_address() {
        for video in [
            "a/DJI_0001.MP4",
            "x.mov",
            "rtsp://10.0.0.1/stream",
            "udp://:5600",
        ] {
            assert!(is_video(Path::new(video)), "{video}");
        }
        for other in ["a.jpg", "folder", "mp4"] {
            assert!(!is_video(Path::new(other)), "{other}");
        }
    }

    #[test]
    fn addresses_are_live_but_for_those_of_video_files() {
        for live in [
            "rtsp://10.0.0.1/stream",
            "rtsp://10.0.0.1/live.mp4",
            "udp://:5600",
            "http://10.0.0.1/stream.mjpg",
        ] {
            assert!(is_live_address(Path::new(live)), "{live}");
        }
        for recorded in [
            "DJI_0001.MP4",
            "file:///data/flight.ts",
            "https://example.org/flight.mp4?version=2",
            "folder",
            "-",
        ] {
            assert!(!is_live_address(Path::new(recorded)), "{recorded}");
        }
    }
}
