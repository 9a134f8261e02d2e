//! What can go wrong with a pack, said so that the reader knows what to do next.

use std::io;
use std::path::{Path, PathBuf};

/// Any failure of building, opening or searching a pack.
#[derive(Debug, thiserror::Error)]
pub enum PackError {
    /// The operating system refused a file operation.
    #[error("cannot {action} {}: {source}{hint}", path.display())]
    Io {
        /// What was tried, as an infinitive ("read", "write").
        action: &'static str,
        /// The file or folder concerned.
        path: PathBuf,
        /// The system's own words.
        source: io::Error,
        /// What to do, empty or starting with "; ".
        hint: &'static str,
    },
    /// The file does not start like a pack.
    #[error(
        "{} is not a grimnet pack; make one with `grim map build MAP -o AREA.grim`",
        path.display()
    )]
    NotAPack {
        /// The file.
        path: PathBuf,
    },
    /// The file ends before its contents do.
    #[error(
        "{} is cut short: {found} of {expected} bytes are there; copy it again or run `grim map build` again",
        path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Bytes that the header promises.
        expected: u64,
        /// Bytes that the file has.
        found: u64,
    },
    /// The pack was written in another format version.
    #[error(
        "{} has pack format {found}, this program reads format {supported}; run `grim map build` again with this program",
        path.display()
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// Version in the file.
        found: u32,
        /// Version of this program.
        supported: u32,
    },
    /// A checksum or an internal reference does not hold.
    #[error(
        "{} is damaged ({what}); copy it again or run `grim map build` again",
        path.display()
    )]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// Which part, and how it was noticed.
        what: String,
    },
    /// The pack, or the map it would be built from, has no usable tile.
    #[error(
        "{} has no usable tile ({why}); check that the map is not blank and covers more than a few pixels",
        path.display()
    )]
    Empty {
        /// The pack.
        path: PathBuf,
        /// Counts of what was skipped.
        why: String,
    },
    /// The pack was built with another model.
    #[error(
        "{} was built with model {pack_model} ({pack_hash}), not with {model} ({model_hash}); \
         give that model with --model, or run `grim map build` again with this one",
        path.display()
    )]
    ModelMismatch {
        /// The pack.
        path: PathBuf,
        /// Name of the model in the pack.
        pack_model: String,
        /// Its hash, shortened.
        pack_hash: String,
        /// Name of the model at hand.
        model: String,
        /// Its hash, shortened.
        model_hash: String,
    },
    /// Another process builds the same pack.
    #[error(
        "another `grim map build` is writing {}; wait for it, or choose another output",
        path.display()
    )]
    Busy {
        /// The pack that is being built.
        path: PathBuf,
    },
    /// An index cannot be trained on so few tiles, or not with these dimensions.
    #[error(
        "no IVF-PQ index: {0}; use the exact index, which is also faster below some 100,000 tiles"
    )]
    Index(String),
    /// The options contradict each other or the map.
    #[error("{0}")]
    Options(String),
    /// A query does not have the pack's dimension.
    #[error(
        "a query descriptor has {found} numbers, the pack's have {expected}; it comes from another model"
    )]
    Dimension {
        /// Length of a row in the pack.
        expected: usize,
        /// Length that was given.
        found: usize,
    },
    /// The map could not be read.
    #[error("cannot read the map: {0}")]
    Map(#[from] grimnet_geo::GeoError),
    /// The network refused its input.
    #[error("cannot compute features: {0}")]
    Net(#[from] grimnet_net::NetError),
}

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, PackError>;

impl PackError {
    /// Wraps a system error with the file and advice for the kinds a user can do something about.
    pub(crate) fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        let hint = match source.kind() {
            io::ErrorKind::StorageFull
            | io::ErrorKind::QuotaExceeded
            | io::ErrorKind::FileTooLarge => {
                "; free some space and run the same command again, it goes on where it stopped"
            }
            io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
                "; choose a folder that you may write to, or change its permissions"
            }
            io::ErrorKind::NotFound => "; check the path",
            _ => "",
        };
        Self::Io {
            action,
            path: path.to_path_buf(),
            source,
            hint,
        }
    }

    /// Shorthand for [`PackError::Corrupt`].
    pub(crate) fn corrupt(path: &Path, what: impl Into<String>) -> Self {
        Self::Corrupt {
            path: path.to_path_buf(),
            what: what.into(),
        }
    }
}
