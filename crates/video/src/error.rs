//! Errors of this crate.

use std::path::PathBuf;

/// Why a video, or a frame of it, could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VideoError {
    /// The file could not be opened or read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The format, or this variant of it, is not supported.
    #[error(
        "{path}: {found}; read here are MP4 and MOV files with H.264 (8 bit, 4:2:0, progressive) or H.265 (Main, Main 10)"
    )]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found in it.
        found: String,
    },
    /// The file has no index of its frames, which cameras write when a recording ends.
    #[error(
        "{path} has no index (`moov`): the recording was not finished, or its end was not copied; copy it again from the \
         camera, or repair it with a program that has a complete recording of the same camera to compare with"
    )]
    NoIndex {
        /// The file.
        path: PathBuf,
    },
    /// The bytes contradict the format.
    #[error("{path} is damaged: {detail}; copy it again from the camera")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        detail: String,
    },
    /// Decoding would take more memory than the limit. This is checked before allocation.
    #[error(
        "{path}: {what} needs {} of memory; the limit is {}",
        grimnet_limits::size(*.needed_bytes),
        grimnet_limits::size(*.limit_bytes)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What is too large.
        what: String,
        /// Estimated memory.
        needed_bytes: u64,
        /// [`grimnet_limits::PhotoLimits::max_memory_bytes`].
        limit_bytes: u64,
    },
    /// One frame cannot be decoded.
    #[error("the frame at {time_s:.3} s of {path} cannot be decoded: {detail}")]
    Frame {
        /// The file.
        path: PathBuf,
        /// When it is shown, seconds from the beginning.
        time_s: f64,
        /// What the decoder found, or what is missing.
        detail: String,
    },
}

impl VideoError {
    /// Whether the file may be a sound video of a kind that is not read here.
    pub fn is_unsupported(&self) -> bool {
        matches!(self, Self::Unsupported { .. })
    }
}

/// What is wrong with a part of a file, whose name is added later.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Fault {
    Unsupported(String),
    Damaged(String),
    TooLarge { what: String, needed_bytes: u64 },
}

impl Fault {
    pub(crate) fn damaged(detail: impl Into<String>) -> Self {
        Self::Damaged(detail.into())
    }

    pub(crate) fn of(self, path: &std::path::Path, limit_bytes: u64) -> VideoError {
        let path = path.to_owned();
        match self {
            Self::Unsupported(found) => VideoError::Unsupported { path, found },
            Self::Damaged(detail) => VideoError::Damaged { path, detail },
            Self::TooLarge { what, needed_bytes } => VideoError::TooLarge {
                path,
                what,
                needed_bytes,
                limit_bytes,
            },
        }
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unsupported(detail) | Self::Damaged(detail) => f.write_str(detail),
            Self::TooLarge { what, needed_bytes } => {
                write!(f, "{what} needs {}", grimnet_limits::size(*needed_bytes))
            }
        }
    }
}
