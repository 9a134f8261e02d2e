//! Which existing files an output may replace.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::aside;
use crate::atomic::AtomicFile;
use crate::error::{OutputError, Result};
use crate::listing::Listing;
use crate::target::{Identity, Place, Snapshot, TargetKind};

/// Which existing files a run may replace: never an input of its own, otherwise only files of this program unless
/// overwriting is allowed.
#[derive(Debug, Clone, Default)]
pub struct OutputPolicy {
    overwrite: bool,
    inputs: Arc<HashMap<Identity, PathBuf>>,
    /// Folders all of whose files are inputs.
    folders: Arc<HashMap<Identity, PathBuf>>,
}

impl OutputPolicy {
    /// Only the program's own files may be replaced.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Whether files that the program did not write may be replaced as well. Inputs are protected either way.
    #[must_use]
    pub fn overwrite(mut self, allowed: bool) -> Self {
        self.overwrite = allowed;
        self
    }

    /// Protects an input, under whatever path an output would name it.
    #[must_use]
    pub fn protect(self, input: impl AsRef<Path>) -> Self {
        self.protect_all([input])
    }

    /// Protects inputs. A path that names nothing needs no protection.
    #[must_use]
    pub fn protect_all(mut self, inputs: impl IntoIterator<Item = impl AsRef<Path>>) -> Self {
        let known = Arc::make_mut(&mut self.inputs);
        for input in inputs {
            let input = input.as_ref();
            if let Ok(identity) = Identity::of(input) {
                known.entry(identity).or_insert_with(|| input.to_owned());
            }
        }
        self
    }

    /// Protects inputs, and every file below those that are folders.
    #[must_use]
    pub fn protect_trees(mut self, inputs: impl IntoIterator<Item = impl AsRef<Path>>) -> Self {
        for input in inputs {
            let input = input.as_ref();
            let known = if input.is_dir() {
                &mut self.folders
            } else {
                &mut self.inputs
            };
            if let Ok(identity) = Identity::of(input) {
                Arc::make_mut(known)
                    .entry(identity)
                    .or_insert_with(|| input.to_owned());
            }
        }
        self
    }

    /// Checks that a file may be written: call it before long work. A file that starts with one of `magics` is the
    /// program's own.
    ///
    /// # Errors
    /// [`OutputError`] if the path is a folder, an input or a file of somebody else, or if its folder is missing or
    /// cannot be written.
    pub fn check_file(&self, path: impl AsRef<Path>, magics: &[&[u8]]) -> Result<()> {
        let path = path.as_ref();
        self.checked(path, magics)?;
        if matches!(TargetKind::of(path)?, TargetKind::Stream) {
            return Ok(());
        }
        let place = Place::of(path)?;
        let (_, aside) = aside::create_hidden(&place)
            .map_err(OutputError::io("create a temporary file for", path))?;
        fs::remove_file(aside).map_err(OutputError::io("remove a temporary file for", path))
    }

    /// Checks `path` as [`check_file`](Self::check_file) does and begins to write it. If the file is created or changed by
    /// somebody else before it is committed, the commit fails with [`OutputError::Changed`].
    ///
    /// # Errors
    /// As [`check_file`](Self::check_file).
    pub fn create(&self, path: impl AsRef<Path>, magics: &[&[u8]]) -> Result<AtomicFile> {
        let path = path.as_ref();
        let snapshot = self.checked(path, magics)?;
        AtomicFile::create_checked(path, snapshot)
    }

    /// Checks `path` and begins to write it as [`AtomicFile::create_partial`] does.
    ///
    /// # Errors
    /// As [`check_file`](Self::check_file).
    pub fn create_partial(&self, path: impl AsRef<Path>) -> Result<AtomicFile> {
        let path = path.as_ref();
        self.checked(path, &[])?;
        AtomicFile::create_partial(path)
    }

    /// Checks `path` and writes it as a whole or not at all.
    ///
    /// # Errors
    /// As [`check_file`](Self::check_file), and if writing fails.
    pub fn write(
        &self,
        path: impl AsRef<Path>,
        write: impl FnOnce(&mut AtomicFile) -> io::Result<()>,
    ) -> Result<()> {
        let mut file = self.create(path, &[])?;
        write(&mut file).map_err(OutputError::io("write", file.path()))?;
        file.commit()
    }

    /// Checks only that `path` is no input: for the program's working files beside an output.
    ///
    /// # Errors
    /// [`OutputError::ReplacesInput`] and [`OutputError::InInputFolder`].
    pub fn check_not_input(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        if let Some(input) = Identity::of(path).ok().and_then(|id| self.inputs.get(&id)) {
            return Err(OutputError::ReplacesInput {
                path: path.to_owned(),
                input: input.clone(),
            });
        }
        match self.input_folder_of(path) {
            Some(folder) => Err(OutputError::InInputFolder {
                path: path.to_owned(),
                folder: folder.clone(),
            }),
            None => Ok(()),
        }
    }

    /// The protected folder that an existing file lies in, at any depth.
    fn input_folder_of(&self, path: &Path) -> Option<&PathBuf> {
        if self.folders.is_empty() {
            return None;
        }
        let path = fs::canonicalize(path).ok()?;
        path.ancestors()
            .skip(1)
            .filter_map(|folder| Identity::of(folder).ok())
            .find_map(|identity| self.folders.get(&identity))
    }

    /// Checks a file by its first bytes and by the list of its folder.
    fn checked(&self, path: &Path, magics: &[&[u8]]) -> Result<Snapshot> {
        self.examine(path, || {
            if starts_with_any(path, magics)? {
                return Ok(true);
            }
            let place = Place::of(path)?;
            match place.name.to_str() {
                Some(name) => Listing::read(&place.folder)?.owns(name, path),
                None => Ok(false),
            }
        })
    }

    /// Checks a file of a folder whose list is at hand.
    pub(crate) fn checked_in(
        &self,
        path: &Path,
        name: &str,
        listing: &Listing,
    ) -> Result<Snapshot> {
        self.examine(path, || listing.owns(name, path))
    }

    /// Checks what stands at `path` and returns how it looked; `is_own` is asked about a file that is no input.
    fn examine(&self, path: &Path, is_own: impl FnOnce() -> Result<bool>) -> Result<Snapshot> {
        let snapshot = Snapshot::of(path).map_err(OutputError::io("examine", path))?;
        let replaceable = match TargetKind::of(path)? {
            TargetKind::Folder => {
                return Err(OutputError::IsFolder {
                    path: path.to_owned(),
                });
            }
            TargetKind::Absent => {
                // Its folder exists, and the path ends in a name.
                Place::of(path)?;
                true
            }
            // What a block device holds is as good as a file.
            TargetKind::Stream => self.overwrite || !is_block_device(path),
            TargetKind::File => {
                self.check_not_input(path)?;
                self.overwrite || is_own()?
            }
        };
        if replaceable {
            Ok(snapshot)
        } else {
            Err(OutputError::NotOwn {
                path: path.to_owned(),
            })
        }
    }
}

fn starts_with_any(path: &Path, magics: &[&[u8]]) -> Result<bool> {
    let Some(longest) = magics.iter().map(|magic| magic.len()).max() else {
        return Ok(false);
    };
    let mut head = Vec::new();
    File::open(path)
        .and_then(|file| file.take(longest as u64).read_to_end(&mut head))
        .map_err(OutputError::io("read", path))?;
    Ok(magics.iter().any(|magic| head.starts_with(magic)))
}

#[cfg(unix)]
fn is_block_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_block_device())
}

#[cfg(not(unix))]
fn is_block_device(_: &Path) -> bool {
    false
}
