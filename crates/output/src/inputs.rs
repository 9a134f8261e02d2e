//! The files that a run reads, which none of its outputs may replace.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::error::{OutputError, Result};
use crate::target::Identity;

/// The inputs of a run. Clones share them: an input that becomes known during the run is protected from every output.
#[derive(Debug, Clone, Default)]
pub(crate) struct Inputs {
    known: Arc<Mutex<Known>>,
}

#[derive(Debug, Default)]
struct Known {
    /// The paths are those that were given.
    files: HashMap<Identity, PathBuf>,
    /// Folders all of whose files are inputs.
    folders: HashMap<Identity, PathBuf>,
}

impl Inputs {
    /// Adds a file. A path that names nothing needs no protection.
    pub(crate) fn add(&self, path: &Path) {
        if let Ok(identity) = Identity::of(path) {
            let mut known = self.known();
            known.files.entry(identity).or_insert(path.to_owned());
        }
    }

    /// Adds a file, or all files below a folder.
    pub(crate) fn add_tree(&self, path: &Path) {
        if !path.is_dir() {
            self.add(path);
        } else if let Ok(identity) = Identity::of(path) {
            let mut known = self.known();
            known.folders.entry(identity).or_insert(path.to_owned());
        }
    }

    /// Checks that `path` is none of them, whatever it is called.
    ///
    /// # Errors
    /// [`OutputError::ReplacesInput`] and [`OutputError::InInputFolder`].
    pub(crate) fn check(&self, path: &Path) -> Result<()> {
        let known = self.known();
        if let Some(input) = Identity::of(path).ok().and_then(|id| known.files.get(&id)) {
            return Err(OutputError::ReplacesInput {
                path: path.to_owned(),
                input: input.clone(),
            });
        }
        match known.folder_of(path) {
            Some(folder) => Err(OutputError::InInputFolder {
                path: path.to_owned(),
                folder: folder.clone(),
            }),
            None => Ok(()),
        }
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        // Each change is a single insertion.
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Known {
    /// The folder among them that an existing file lies in, at any depth.
    fn folder_of(&self, path: &Path) -> Option<&PathBuf> {
        if self.folders.is_empty() {
            return None;
        }
        let path = fs::canonicalize(path).ok()?;
        path.ancestors()
            .skip(1)
            .filter_map(|folder| Identity::of(folder).ok())
            .find_map(|identity| self.folders.get(&identity))
    }
}
