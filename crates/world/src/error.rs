//! Errors of placing a world on the globe and of writing its files.

use std::path::{Path, PathBuf};

use grimnet_output::OutputError;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WorldError {
    /// A file could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A picture or table could not be encoded.
    #[error("cannot encode {path}: {reason}")]
    Encode {
        /// The file.
        path: PathBuf,
        /// The encoder's message.
        reason: String,
    },
    /// A place cannot be expressed in a UTM zone.
    #[error("cannot place the world at longitude {lon_deg}, latitude {lat_deg}: {reason}")]
    Place {
        /// Degrees east; NaN if not known.
        lon_deg: f64,
        /// Degrees north; NaN if not known.
        lat_deg: f64,
        /// Why not.
        reason: String,
    },
}

impl WorldError {
    pub(crate) fn encode(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::Encode {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }
}
