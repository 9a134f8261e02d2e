//! A video file.

use std::fs::File;
use std::path::Path;

use grimnet_limits::PhotoLimits;

use crate::error::VideoError;
use crate::movie::Movie;
use crate::sample_entry::Codec;
use crate::sample_source::SampleSource;
use crate::selection;
use crate::video_frames::VideoFrames;

/// What a file says of its video.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct VideoInfo {
    /// How it is coded: `H.264` or `H.265`.
    pub codec: &'static str,
    /// Size of its pictures as they are shown, px.
    pub size_px: (u32, u32),
    /// Width of a coded pixel in proportion to its height, if they are not square: 4:3 is (4, 3). Its pictures are stretched in one
    /// direction to square pixels.
    pub pixel_aspect: Option<(u32, u32)>,
    /// Number of frames that are shown.
    pub frames: usize,
    /// When the first and the last frame are shown, seconds.
    pub shown_s: (f64, f64),
    /// If the end of the file is missing: when the last frame would be shown, seconds.
    pub truncated_at_s: Option<f64>,
    /// When the file says that it was made: seconds from 1970-01-01 by the camera's clock, which often shows local time. Cameras
    /// differ in whether it is the beginning or the end.
    pub created_unix_s: Option<f64>,
}

/// A video that can be decoded.
#[derive(Debug)]
pub struct Video {
    pub(crate) source: SampleSource,
    pub(crate) movie: Movie,
    info: VideoInfo,
}

impl Video {
    /// Reads the index of a file, and decodes its first frame to see whether it can be.
    ///
    /// # Errors
    /// [`VideoError::Unsupported`] for what another decoder may read; others if the file cannot be read or is damaged, or its
    /// pictures or its index are above the limit, which is compared before they are allocated.
    pub fn open(path: impl AsRef<Path>, limits: &PhotoLimits) -> Result<Self, VideoError> {
        let path = path.as_ref().to_owned();
        let read_error = |source| VideoError::Read {
            path: path.clone(),
            source,
        };
        let mut file = File::open(&path).map_err(read_error)?;
        let movie = Movie::read(&path, &mut file, limits)?;
        let mut source = SampleSource::new(path, file, limits.max_memory_bytes);
        let (size_px, aspect) = source.try_first(&movie)?;
        let times = || movie.shown_s.iter().flatten().copied();
        let info = VideoInfo {
            codec: match movie.codec {
                Codec::H264 => "H.264",
                Codec::H265 => "H.265",
            },
            size_px,
            pixel_aspect: aspect.map(|aspect| (aspect.width, aspect.height)),
            frames: times().count(),
            shown_s: (
                times().fold(f64::INFINITY, f64::min),
                times().fold(f64::NEG_INFINITY, f64::max),
            ),
            truncated_at_s: movie.truncated_at_s,
            created_unix_s: movie.created_unix_s,
        };
        Ok(Self {
            source,
            movie,
            info,
        })
    }

    /// What the file says of it.
    pub fn info(&self) -> &VideoInfo {
        &self.info
    }

    /// Decodes so many frames of each second, those nearest to whole multiples of its inverse from the first frame on; all frames
    /// if the video has fewer. They come in the order in which they are shown.
    ///
    /// # Errors
    /// The parameter sets are damaged.
    pub fn at_rate(self, frames_per_s: f64) -> Result<VideoFrames, VideoError> {
        let taken = selection::at_rate(&self.movie.shown_s, frames_per_s);
        VideoFrames::new(self.source, self.movie, taken)
    }
}
