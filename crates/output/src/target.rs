//! What a path names: a file, a folder, a stream or nothing yet; and whether two paths name the same file.

use std::ffi::OsString;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::error::{OutputError, Result};

/// What stands at an output path, symbolic links followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum TargetKind {
    /// Nothing.
    Absent,
    /// A regular file.
    File,
    /// A folder.
    Folder,
    /// A device, pipe, FIFO or socket: written through.
    Stream,
}

impl TargetKind {
    /// Looks at `path`.
    ///
    /// # Errors
    /// [`OutputError::Io`] if the path cannot be examined.
    pub fn of(path: &Path) -> Result<Self> {
        if names_open_file(path) {
            return Ok(Self::Stream);
        }
        match fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => Ok(Self::Folder),
            Ok(metadata) if metadata.is_file() => Ok(Self::File),
            Ok(_) => Ok(Self::Stream),
            Err(error) if is_absent(&error) => Ok(Self::Absent),
            Err(error) => Err(OutputError::io("examine", path)(error)),
        }
    }
}

/// Whether nothing stands at a path; a folder of it may also be missing, or be a file.
fn is_absent(error: &io::Error) -> bool {
    use io::ErrorKind::{NotADirectory, NotFound};
    matches!(error.kind(), NotFound | NotADirectory)
}

/// Names of files that the process has open already: renaming over what they stand for would cut them off, even where
/// that is a regular file.
fn names_open_file(path: &Path) -> bool {
    path == Path::new("/dev/stdout")
        || path == Path::new("/dev/stderr")
        || path.starts_with("/dev/fd")
        || path.starts_with("/proc/self/fd")
}

/// Most symbolic links that are followed, one after the other: as Linux.
pub(crate) const MAX_LINKS: usize = 40;

/// Where a regular file is written: folder and name, after following symbolic links.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    pub(crate) folder: PathBuf,
    pub(crate) name: OsString,
}

impl Place {
    /// Follows symbolic links, also to a file that is not there yet. A link is thus kept and its file replaced.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        let mut place = path.to_owned();
        for _ in 0..MAX_LINKS {
            let Ok(link) = fs::read_link(&place) else {
                return Self::split(path, &place);
            };
            place = folder_of(&place).join(link);
        }
        let error = io::Error::other("too many symbolic links, one after the other");
        Err(OutputError::io("follow the symbolic links of", path)(error))
    }

    fn split(given: &Path, place: &Path) -> Result<Self> {
        let ends_in_separator = given
            .as_os_str()
            .as_encoded_bytes()
            .ends_with(std::path::MAIN_SEPARATOR_STR.as_bytes());
        let name = place.file_name().filter(|_| !ends_in_separator);
        let Some(name) = name else {
            return Err(OutputError::IsFolder {
                path: given.to_owned(),
            });
        };
        let folder = folder_of(place);
        if !folder.is_dir() {
            return Err(OutputError::NoFolder {
                path: given.to_owned(),
                folder: folder.to_owned(),
            });
        }
        Ok(Self {
            folder: folder.to_owned(),
            name: name.to_owned(),
        })
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.join(&self.name)
    }
}

/// The path of the file that is written when `path` is: if that is a symbolic link, what it leads to, which need not be
/// there yet. For writers that keep working files beside their output, which have to be on the same disk.
///
/// # Errors
/// [`OutputError`] if the links form a circle, or lead into a folder that does not exist.
pub fn linked_path(path: &Path) -> Result<PathBuf> {
    if path.is_symlink() {
        Ok(Place::of(path)?.path())
    } else {
        Ok(path.to_owned())
    }
}

/// The folder that holds `path`; `.` for a bare name.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// The same for two names of one file: hard links, symbolic links, `a/../b`.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) enum Identity {
    /// Device and inode.
    #[cfg(unix)]
    Inode(u64, u64),
    /// The canonical path, where there are no inodes.
    #[cfg(not(unix))]
    Path(PathBuf),
}

impl Identity {
    /// The identity of an existing file.
    pub(crate) fn of(path: &Path) -> io::Result<Self> {
        let metadata = fs::metadata(path)?;
        Self::from_metadata(&metadata, path)
    }

    #[cfg(unix)]
    #[expect(
        clippy::unnecessary_wraps,
        reason = "other systems need the file system"
    )]
    pub(crate) fn from_metadata(metadata: &Metadata, _: &Path) -> io::Result<Self> {
        use std::os::unix::fs::MetadataExt as _;
        Ok(Self::Inode(metadata.dev(), metadata.ino()))
    }

    #[cfg(not(unix))]
    pub(crate) fn from_metadata(_: &Metadata, path: &Path) -> io::Result<Self> {
        fs::canonicalize(path).map(Self::Path)
    }
}

/// A file at one moment; equal if it was neither replaced nor written to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Snapshot(Option<(Identity, u64, Option<SystemTime>)>);

impl Snapshot {
    /// Looks at `path`, symbolic links followed. Nothing there is a state, too.
    ///
    /// # Errors
    /// The path cannot be examined.
    pub fn of(path: &Path) -> io::Result<Self> {
        let metadata = match fs::metadata(path) {
            Ok(metadata) => metadata,
            Err(error) if is_absent(&error) => return Ok(Self(None)),
            Err(error) => return Err(error),
        };
        let identity = Identity::from_metadata(&metadata, path)?;
        Ok(Self(Some((
            identity,
            metadata.len(),
            metadata.modified().ok(),
        ))))
    }

    /// Checks that `place` still looks so; `path` is how errors name it.
    ///
    /// # Errors
    /// [`OutputError::Changed`] if it does not; [`OutputError`] if it cannot be examined.
    pub(crate) fn check(&self, place: &Path, path: &Path) -> Result<()> {
        let now = Self::of(place).map_err(OutputError::io("examine", path))?;
        if now != *self {
            return Err(OutputError::Changed {
                path: path.to_owned(),
            });
        }
        Ok(())
    }
}
