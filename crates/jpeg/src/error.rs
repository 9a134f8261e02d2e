//! Errors of this crate.

/// Why a JPEG could not be read. The file is not named: the caller knows it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum JpegError {
    /// The file ends before the picture does.
    #[error("it ends too early: {0}")]
    Truncated(String),
    /// The bytes contradict the format.
    #[error("{0}")]
    Corrupt(String),
    /// A variant of the format that is not supported.
    #[error("{0} is not supported")]
    Unsupported(String),
}
