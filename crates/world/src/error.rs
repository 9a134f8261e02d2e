//! What can go wrong when a world is placed on the globe or written to disk.

use std::path::PathBuf;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// A file could not be written.
    #[error("cannot write {path}: {source}; check the folder, its permissions and the free space")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The picture could not be encoded.
    #[error("cannot encode {path}: {reason}")]
    Encode {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        reason: String,
    },
    /// The place cannot be expressed in a UTM zone.
    #[error("cannot place the world at longitude {lon_deg}, latitude {lat_deg}: {reason}")]
    Place {
        /// Degrees east.
        lon_deg: f64,
        /// Degrees north.
        lat_deg: f64,
        /// What is wrong with it.
        reason: String,
    },
}

impl WorldError {
    pub(crate) fn write(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Write { path, source }
    }

    pub(crate) fn encode(path: &std::path::Path, reason: impl std::fmt::Display) -> Self {
        Self::Encode {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }
}
