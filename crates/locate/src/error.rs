//! What can go wrong beside not finding the place.

use crate::matching::MatchingError;

/// A result of this crate.
pub type Result<T> = std::result::Result<T, LocateError>;

/// What can go wrong. A photo whose place is not found is no error but [`crate::Outcome::NoFix`].
#[derive(Debug, thiserror::Error)]
pub enum LocateError {
    /// The network refuses.
    #[error(transparent)]
    Net(#[from] grimnet_net::NetError),
    /// The pack refuses.
    #[error(transparent)]
    Pack(#[from] grimnet_pack::PackError),
    /// The photo cannot be resampled.
    #[error(transparent)]
    Photo(#[from] grimnet_photo::PhotoError),
    /// A coordinate has no place on Earth.
    #[error(transparent)]
    Geo(#[from] grimnet_geo::GeoError),
    /// Descriptors cannot be compared.
    #[error(transparent)]
    Matching(#[from] MatchingError),
    /// An option or prior that means nothing.
    #[error("{name} is {value}: {expected}")]
    BadOption {
        /// Which.
        name: &'static str,
        /// As given.
        value: String,
        /// What it must be.
        expected: &'static str,
    },
    /// Paper mode needs the paper's tiles.
    #[error("{path} was built in default mode: build it with --mode paper, or locate with --mode default", path = path.display())]
    NotAPaperPack {
        /// The pack.
        path: std::path::PathBuf,
    },
    /// Drawing needs the matched points.
    #[error("the answer holds no matched points: locate with Options::keep_matches")]
    NoMatchesKept,
}
