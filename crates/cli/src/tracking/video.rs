//! A video as frames: decoded here if it can be, else by an `ffmpeg` process.

use std::path::Path;

use anyhow::Result;
use grimnet_photo::PhotoLimits;

use super::ffmpeg::FfmpegVideo;
use super::frames::Frames;
#[cfg(feature = "video")]
use super::video_file::VideoFile;

/// Endings of video files, lower case.
const VIDEO_ENDINGS: &[&str] = &[
    "mp4", "mov", "m4v", "mkv", "avi", "ts", "m2ts", "mts", "mpg", "mpeg", "webm", "h264", "h265",
];
/// Endings of those that are read here.
#[cfg(feature = "video")]
const BUILT_IN_ENDINGS: &[&str] = &["mp4", "mov", "m4v"];
/// Frames per second that are taken from a video if nothing else is asked for.
pub const DEFAULT_FRAMES_PER_S: f64 = 2.0;

/// Whether a source is a video: by its ending, or an address such as `rtsp://`.
pub fn is_video(source: &Path) -> bool {
    is_address(source) || has_ending(source, VIDEO_ENDINGS)
}

fn is_address(source: &Path) -> bool {
    source.to_string_lossy().contains("://")
}

/// Whether a file's name ends so, in upper or lower case.
pub fn has_ending(source: &Path, endings: &[&str]) -> bool {
    let ending = source
        .extension()
        .map(|e| e.to_string_lossy().to_lowercase());
    ending.is_some_and(|ending| endings.contains(&ending.as_str()))
}

/// Opens a video; `frames_per_s` frames are taken of each second.
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
                let video = FfmpegVideo::open(source, frames_per_s, limits)
                    .map_err(|ffmpeg| ffmpeg.context(error.to_string()))?;
                tracing::info!("{error}; ffmpeg decodes it");
                return Ok(Box::new(video));
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(Box::new(FfmpegVideo::open(source, frames_per_s, limits)?))
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
}
