//! What can go wrong with a photo, naming the file and what to do about it.

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
    /// The file has no bytes.
    #[error("{path} is empty (0 bytes): copy it again from the camera")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Neither of the formats that are read, or a variant of one that is not.
    #[error("{path}: {found}; photos are read as JPEG, PNG, TIFF or WebP")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found in it.
        found: String,
    },
    /// The file ends before the picture does.
    #[error("{path} is cut off: {detail}; copy it again from the camera")]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where it ends.
        detail: String,
    },
    /// The bytes contradict the format.
    #[error("{path} is damaged: {detail}")]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// What the decoder found.
        detail: String,
    },
    /// More pixels than are decoded; checked before any allocation.
    #[error(
        "{path} claims {width_px} x {height_px} px, more than the limit of {limit_px} px: \
         a photo of that size is refused (split an orthophoto, or build a map from it)"
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Claimed width, px.
        width_px: u32,
        /// Claimed height, px.
        height_px: u32,
        /// The limit, px in all.
        limit_px: u64,
    },
    /// Too few pixels to look at, 0 x 0 and 1 x 1 among them.
    #[error("{path} is {width_px} x {height_px} px: a photo needs at least {minimum_px} px a side")]
    TooSmall {
        /// The file.
        path: PathBuf,
        /// Width, px.
        width_px: u32,
        /// Height, px.
        height_px: u32,
        /// The least side, px.
        minimum_px: u32,
    },
    /// A number that a query cannot be made with.
    #[error("{name} = {value}: {reason}")]
    BadRequest {
        /// Which number.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it should be.
        reason: &'static str,
    },
    /// The camera looks too far from straight down for the ground at the picture's centre to be of use.
    #[error(
        "the camera looked {pitch_from_nadir_deg:.0} degrees off straight down: \
         beyond {limit_deg:.0} degrees there is too little ground to rectify"
    )]
    Horizon {
        /// Angle between the optical axis and straight down, degrees.
        pitch_from_nadir_deg: f64,
        /// The limit, degrees.
        limit_deg: f64,
    },
}
