//! The errors of this crate.

use std::io;
use std::path::{Path, PathBuf};

use grimnet_output::OutputError;

/// An error of building, opening or searching a pack. It says what is wrong, what was expected, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PackError {
    /// The operating system refused a file operation.
    #[error("cannot {action} {}: {source}{hint}", path.display())]
    Io {
        /// What was attempted, as an infinitive ("read", "write").
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
        /// What to do, empty or starting with "; ".
        hint: &'static str,
    },
    /// The file does not start like a pack.
    #[error("{} is not a grimnet pack; build one from a map", path.display())]
    NotAPack {
        /// The file.
        path: PathBuf,
    },
    /// The output of a build is not a regular file.
    #[error(
        "{} is a folder or a device; expected the path of a file to write the pack to",
        path.display()
    )]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The file ends before its contents do.
    #[error(
        "{} is truncated: it has {found} bytes, expected {expected}; copy it again or build it again",
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
        "{} has pack format {found}, this program reads format {supported}; build the pack again with this program",
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
    #[error("{} is damaged ({what}); copy it again or build it again", path.display())]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// Which part, and how it was noticed.
        what: String,
    },
    /// The file was truncated or overwritten while it was open.
    #[error(
        "{} was changed while it was in use: it had {expected} bytes and now has {found}; open it again, and replace \
         packs by renaming a new file",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// Bytes on opening.
        expected: u64,
        /// Bytes now.
        found: u64,
    },
    /// A part of the pack exceeds a limit of [`crate::PackLimits`].
    #[error("{}: its {what} have {found} bytes, more than the limit of {limit}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Which part.
        what: &'static str,
        /// Its size, bytes.
        found: u64,
        /// The limit, bytes.
        limit: u64,
    },
    /// The map has no usable tile.
    #[error("the map has no usable tile: {map}: {why}")]
    Empty {
        /// The map, as it describes itself.
        map: String,
        /// What was found, and the likely cause.
        why: String,
    },
    /// What a build would cost exceeds a limit of [`crate::BuildLimits`].
    #[error(
        "the pack would be too large: {what}; choose coarser ground resolutions or a smaller map"
    )]
    TooCostly {
        /// The number that exceeds its limit.
        what: String,
    },
    /// The map's files were changed while its pack was built.
    #[error("the map was changed while the pack was built; build it again: {map}")]
    MapChanged {
        /// The map, as it describes itself.
        map: String,
    },
    /// The map's scale on the ground is implausible.
    #[error("the map cannot be used: {map}: {what}; check its coordinate system and scale")]
    Scale {
        /// The map, as it describes itself.
        map: String,
        /// The number that is out of range.
        what: String,
    },
    /// The pack was built with another model.
    #[error(
        "{} was built with model {pack_model} ({pack_hash}), not with {model} ({model_hash}); use that model, or build \
         the pack again with this one",
        path.display()
    )]
    ModelMismatch {
        /// The pack.
        path: PathBuf,
        /// Name of the model in the pack.
        pack_model: String,
        /// Its hash, shortened.
        pack_hash: String,
        /// Name of the model in use.
        model: String,
        /// Its hash, shortened.
        model_hash: String,
    },
    /// Another process builds the same pack.
    #[error("another process is building {}; wait for it, or choose another output", path.display())]
    Busy {
        /// The pack that is being built.
        path: PathBuf,
    },
    /// A file that is not of a build stands where a build keeps its work.
    #[error(
        "{} is in the way of the build, which keeps its work under that name: {why}; move it elsewhere, or choose another \
         output",
        path.display()
    )]
    InTheWay {
        /// The file.
        path: PathBuf,
        /// How it was noticed.
        why: &'static str,
    },
    /// The caller ended the build.
    #[error(
        "the build of {path} was stopped; the work so far is in {path}.partial, and the same build continues there",
        path = path.display()
    )]
    Stopped {
        /// The pack that was being built.
        path: PathBuf,
    },
    /// An index cannot be trained on so few tiles, or with these dimensions, or the level does not have it.
    #[error(
        "no IVF-PQ index: {0}; use exact search, which is also faster below about 100,000 tiles"
    )]
    Index(String),
    /// The options are invalid, or do not fit the map.
    #[error("{0}")]
    Options(String),
    /// A query does not have the pack's dimension.
    #[error(
        "a query descriptor has {found} numbers, expected a multiple of {expected}; it comes from another model"
    )]
    Dimension {
        /// Dimension of the pack's tile descriptors.
        expected: usize,
        /// Length that was given.
        found: usize,
    },
    /// The finished pack could not be put in place.
    #[error("cannot put the pack in place: {source}")]
    Output {
        /// What failed.
        #[from]
        source: OutputError,
    },
    /// The map could not be read.
    #[error("cannot read the map: {0}")]
    Map(#[from] grimnet_geo::GeoError),
    /// The network refused its input.
    #[error("cannot compute features: {0}")]
    Net(#[from] grimnet_net::NetError),
}

/// Actions of [`PackError::Io`] that change nothing.
const READING: [&str; 4] = ["open", "read", "map into memory", "examine"];

/// Result of this crate's functions.
pub type Result<T> = std::result::Result<T, PackError>;

impl PackError {
    /// Wraps a system error with the file and advice for the kinds that a user can resolve.
    pub(crate) fn io(action: &'static str, path: &Path, source: io::Error) -> Self {
        let hint = match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                "; free some space and run the same command again, it continues where it stopped"
            }
            io::ErrorKind::FileTooLarge => {
                "; this file system, or a limit of the user (ulimit -f), takes no larger files: choose another folder"
            }
            io::ErrorKind::PermissionDenied if READING.contains(&action) => {
                "; change its permissions so that you may read it"
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

    /// An error of the journal of a build.
    pub(crate) fn of_journal(error: OutputError) -> Self {
        match error {
            OutputError::Io { step, path, source } => Self::io(step, &path, source),
            OutputError::Busy { path } => Self::Busy { path },
            OutputError::InTheWay { path, why } => Self::InTheWay { path, why },
            source => Self::Output { source },
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_to_do_fits_what_was_attempted() {
        let advice = |action| {
            let denied = io::Error::from(io::ErrorKind::PermissionDenied);
            PackError::io(action, Path::new("town.grim"), denied).to_string()
        };
        for action in READING {
            let advice = advice(action);
            assert!(
                advice.contains("read it") && !advice.contains("write"),
                "{advice}"
            );
        }
        assert!(advice("create").contains("you may write to"));
    }
}
