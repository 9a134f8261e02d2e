//! What can go wrong when a file is written.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Result of this crate's functions.
pub type Result<T> = std::result::Result<T, OutputError>;

/// Any failure of writing a file, or a refusal to replace one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The operating system refused a step. The message names the path and the step; the cause is the source.
    #[error("cannot {step} {}: {source}", path.display())]
    Io {
        /// What was attempted, as an infinitive with its object's preposition, such as "write" or "rename a temporary
        /// file to".
        step: &'static str,
        /// The output file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The output is a file that this run reads.
    #[error(
        "{} is the same file as the input {}; an output never replaces an input: choose another output path",
        path.display(), input.display()
    )]
    ReplacesInput {
        /// The output as given.
        path: PathBuf,
        /// The input as given.
        input: PathBuf,
    },
    /// The output is a file in a folder whose files this run reads.
    #[error(
        "{} is a file of the input {}; an output never replaces an input: choose another output path",
        path.display(), folder.display()
    )]
    InInputFolder {
        /// The output as given.
        path: PathBuf,
        /// The folder as given.
        folder: PathBuf,
    },
    /// Two outputs of one run would be written to the same place.
    #[error("{first} and {second} would both write {}; give each a path of its own", path.display())]
    Meet {
        /// What asks for the one output, such as an option.
        first: String,
        /// What asks for the other.
        second: String,
        /// The path of the other as given.
        path: PathBuf,
    },
    /// The file exists, and is not known to be the program's own: neither its first bytes nor the list of its folder say so.
    #[error(
        "{} already exists and is not known to be an unchanged file of this program; choose another output path, or allow \
         overwriting",
        path.display()
    )]
    NotOwn {
        /// The existing file.
        path: PathBuf,
    },
    /// A file was expected and the path is that of a folder.
    #[error("{} is a folder; expected the path of a file", path.display())]
    IsFolder {
        /// The path as given.
        path: PathBuf,
    },
    /// A folder was expected and the path is that of something else.
    #[error("{} exists and is not a folder; choose another output folder", path.display())]
    NotAFolder {
        /// The path as given.
        path: PathBuf,
    },
    /// The folder that should hold the file does not exist.
    #[error("{}: the folder {} does not exist; create it first", path.display(), folder.display())]
    NoFolder {
        /// The output as given.
        path: PathBuf,
        /// The missing folder.
        folder: PathBuf,
    },
    /// Another process writes into the folder.
    #[error("another run is writing into {}; wait for it, or choose another output folder", path.display())]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// Another process does the work that ends in this file.
    #[error("another run is making {}; wait for it, or choose another output", path.display())]
    Busy {
        /// The output.
        path: PathBuf,
    },
    /// A file that is no [`Journal`](crate::Journal) stands where a run keeps its work so far.
    #[error(
        "{} is in the way of this run, which keeps its work so far under that name: {why}; move it elsewhere, or choose \
         another output",
        path.display()
    )]
    InTheWay {
        /// The file.
        path: PathBuf,
        /// How it was noticed.
        why: &'static str,
    },
    /// The file changed between the check and the end of writing.
    #[error(
        "{} was created or changed by another program in the meantime; it was left as it is",
        path.display()
    )]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// A name that would leave the folder, or that cannot be a file name.
    #[error("`{}` cannot be the name of an output file: expected one name without folders", name.escape_debug())]
    BadName {
        /// The name.
        name: String,
    },
}

impl OutputError {
    /// Wraps an error of the operating system with what was done to which file.
    pub(crate) fn io(step: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Io {
            step,
            path,
            source: WriteFailed::inner(source),
        }
    }

    /// Whether the reader of a pipe went away (`| head`), which is no failure of this program.
    #[must_use]
    pub fn is_broken_pipe(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == io::ErrorKind::BrokenPipe)
    }
}

/// Error of a write to a known file, inside an [`io::Error`]: so that the file is named also where the error passes
/// through a library that knows nothing of files.
#[derive(Debug)]
pub(crate) struct WriteFailed {
    path: PathBuf,
    source: io::Error,
}

impl WriteFailed {
    pub(crate) fn wrap(path: &Path, source: io::Error) -> io::Error {
        // `write_all` and others retry these by themselves: they have to arrive as they are.
        if source.kind() == io::ErrorKind::Interrupted {
            return source;
        }
        let path = path.to_owned();
        io::Error::new(source.kind(), Self { path, source })
    }

    /// Takes the original error out again.
    fn inner(error: io::Error) -> io::Error {
        match error.downcast::<Self>() {
            Ok(failed) => failed.source,
            Err(error) => error,
        }
    }
}

impl fmt::Display for WriteFailed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot write {}: {}", self.path.display(), self.source)
    }
}

impl std::error::Error for WriteFailed {}
