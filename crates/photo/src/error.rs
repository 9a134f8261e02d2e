//! Errors of this crate.

use std::path::PathBuf;

/// Why a photo could not be read, or a query could not be made from it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PhotoError {
    /// The file could not be opened or read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A pipe, a device or a folder.
    #[error(
        "{path} is not a regular file but a pipe, a device or a folder: save the photo to a file first"
    )]
    NotRegular {
        /// The file.
        path: PathBuf,
    },
    /// The file has no bytes.
    #[error("{path} is empty (0 bytes): copy it again from the camera")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The format, or this variant of it, is not supported.
    #[error("{path}: {found}; save it as JPEG or PNG (WebP and common TIFF are read as well)")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found in it.
        found: String,
    },
    /// The file ends before the picture does.
    #[error("{path} is truncated: {detail}; copy it again from the camera")]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the data end.
        detail: String,
    },
    /// The bytes contradict the format.
    #[error("{path} is damaged: {detail}; copy it again from the camera")]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// What the decoder found.
        detail: String,
    },
    /// Decoding the photo would take more memory than the limit. This is checked before allocation.
    #[error(
        "{path} has {width_px} x {height_px} px and needs {} of memory; the limit for a photo is {} \
         (an orthophoto is a map: build a pack from it)",
        grimnet_limits::size(*.needed_bytes),
        grimnet_limits::size(*.limit_bytes)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// Estimated memory to decode it.
        needed_bytes: u64,
        /// [`grimnet_limits::PhotoLimits::max_memory_bytes`].
        limit_bytes: u64,
    },
    /// The file alone is larger than the limit. This is checked before it is read.
    #[error(
        "{path} has {}; the limit for a photo is {} (an orthophoto is a map: build a pack from it)",
        grimnet_limits::size(*.bytes),
        grimnet_limits::size(*.limit_bytes)
    )]
    FileTooLarge {
        /// The file.
        path: PathBuf,
        /// Its size, or how much of it was read.
        bytes: u64,
        /// [`grimnet_limits::PhotoLimits::max_memory_bytes`].
        limit_bytes: u64,
    },
    /// The photo is too small.
    #[error("{path} has {width_px} x {height_px} px; each side must be at least {minimum_px} px")]
    TooSmall {
        /// The file.
        path: PathBuf,
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// The minimum side, px.
        minimum_px: u32,
    },
    /// A value with which no query can be made.
    #[error("{name} is {value}; {reason}")]
    BadRequest {
        /// Name of the value.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is expected.
        reason: &'static str,
    },
    /// The tilt is too large to rectify the photo.
    #[error(
        "the camera was tilted by {pitch_from_nadir_deg:.0} degrees from nadir; \
         photos are rectified up to {limit_deg:.0} degrees"
    )]
    Horizon {
        /// Angle between the optical axis and straight down, degrees.
        pitch_from_nadir_deg: f64,
        /// The limit, degrees.
        limit_deg: f64,
    },
}
