//! Errors of this crate.

use std::path::PathBuf;

use crate::search::matching::MatchingError;

/// A result of this crate.
pub type Result<T> = std::result::Result<T, LocateError>;

/// Why a photo cannot be localised at all. A photo whose position is not found is no error but [`crate::Outcome::NoFix`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LocateError {
    /// The network cannot run.
    #[error(transparent)]
    Net(#[from] grimnet_net::NetError),
    /// The pack cannot be used.
    #[error(transparent)]
    Pack(#[from] grimnet_pack::PackError),
    /// The photo cannot be read or resampled.
    #[error(transparent)]
    Photo(#[from] grimnet_photo::PhotoError),
    /// A coordinate has no position on Earth, or the map cannot be read.
    #[error(transparent)]
    Geo(#[from] grimnet_geo::GeoError),
    /// The descriptors of photo and pack cannot be compared.
    #[error(transparent)]
    Matching(#[from] MatchingError),
    /// A setting or a prior value is invalid.
    #[error("{field} is {value}; expected {expected}")]
    InvalidValue {
        /// Name of the field.
        field: &'static str,
        /// The value.
        value: String,
        /// The valid values.
        expected: &'static str,
    },
    /// Paper mode needs a pack that was built in paper mode.
    #[error(
        "{path} was built in default mode; paper mode needs a pack that was built in paper mode",
        path = path.display()
    )]
    NotAPaperPack {
        /// The pack.
        path: PathBuf,
    },
    /// The matches cannot be drawn because the answer does not hold them.
    #[error("the answer holds no matched points; set `Options::keep_matches` before locating")]
    NoMatchesKept,
}
