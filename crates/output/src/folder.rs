//! A folder of results: which files in it are the program's own is kept in its list.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::aside;
use crate::atomic::{AtomicFile, hash_of};
use crate::error::{OutputError, Result};
use crate::listing::{LISTING_NAME, Listing};
use crate::policy::OutputPolicy;
use crate::target::TargetKind;

/// A folder that one run writes into. Each file is replaced as a whole or not at all, is listed in the folder's
/// `.grim-output`, and may be replaced or removed by a later run as long as its content is the one that was listed.
///
/// While it is open, no other process can open it. Folders that were created for it and are still empty when it is dropped
/// are removed.
#[derive(Debug, Clone)]
pub struct OutputFolder {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    policy: OutputPolicy,
    state: Mutex<State>,
    /// The folders that were created for it, the innermost first.
    created: Vec<PathBuf>,
    /// Holds the lock.
    _lock: Option<File>,
    /// The folder that this one was opened in, which goes after it.
    _above: Option<OutputFolder>,
}

impl Drop for Inner {
    /// A run that wrote nothing leaves no folder.
    fn drop(&mut self) {
        for folder in &self.created {
            // One that holds something stays.
            let _ = fs::remove_dir(folder);
        }
    }
}

#[derive(Debug)]
struct State {
    listing: Listing,
    written: BTreeSet<String>,
}

impl OutputFolder {
    /// Opens a folder for writing; creates it, and the folders above, if it does not exist.
    ///
    /// # Errors
    /// [`OutputError::NotAFolder`], [`OutputError::InUse`] if another process has it open, [`OutputError::NotOwn`] if
    /// its `.grim-output` was written by something else, and what the file system refuses.
    pub fn open(path: impl AsRef<Path>, policy: &OutputPolicy) -> Result<Self> {
        Self::open_in(None, path.as_ref(), policy)
    }

    fn open_in(above: Option<&Self>, path: &Path, policy: &OutputPolicy) -> Result<Self> {
        let created = match TargetKind::of(path)? {
            TargetKind::Folder => Vec::new(),
            TargetKind::Absent => {
                let missing = missing_folders(path);
                fs::create_dir_all(path).map_err(OutputError::io("create the folder", path))?;
                missing
            }
            TargetKind::File | TargetKind::Stream => {
                return Err(OutputError::NotAFolder {
                    path: path.to_owned(),
                });
            }
        };
        let lock = lock(path)?;
        aside::sweep(path);
        let state = State {
            listing: Listing::read(path)?,
            written: BTreeSet::new(),
        };
        Ok(Self {
            inner: Arc::new(Inner {
                path: path.to_owned(),
                policy: policy.clone(),
                state: Mutex::new(state),
                created,
                _lock: lock,
                _above: above.cloned(),
            }),
        })
    }

    /// Opens a folder in this one under the same policy. It has its own list.
    ///
    /// # Errors
    /// As [`open`](Self::open), and [`OutputError::BadName`].
    pub fn subfolder(&self, name: &str) -> Result<Self> {
        Self::open_in(Some(self), &self.file_path(name)?, &self.inner.policy)
    }

    /// The folder's path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.inner.path
    }

    /// Checks that files of these names may be written: call it before long work.
    ///
    /// # Errors
    /// [`OutputError::NotOwn`], [`OutputError::ReplacesInput`], [`OutputError::IsFolder`] or [`OutputError::BadName`] for
    /// the first name that may not; [`OutputError::Io`] if nothing can be written into the folder.
    pub fn check(&self, names: impl IntoIterator<Item = impl AsRef<str>>) -> Result<()> {
        let state = self.state();
        for name in names {
            let name = name.as_ref();
            self.inner
                .policy
                .checked_in(&self.file_path(name)?, name, &state.listing)?;
        }
        // Under the list's name, which nothing else has. A file that is dropped before it is committed leaves nothing.
        match AtomicFile::create(self.inner.path.join(LISTING_NAME)) {
            Err(OutputError::Io { source, .. }) => Err(OutputError::io(
                "write into the folder",
                &self.inner.path,
            )(source)),
            checked => checked.map(drop),
        }
    }

    /// Begins to write a file.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn create(&self, name: &str) -> Result<FolderFile> {
        let path = self.file_path(name)?;
        let checked = self
            .inner
            .policy
            .checked_in(&path, name, &self.state().listing)?;
        Ok(FolderFile {
            folder: self.clone(),
            name: name.to_owned(),
            file: self.inner.policy.create_checked(&path, checked)?,
        })
    }

    /// Begins to write a long file whose beginning is worth something, as [`AtomicFile::create_partial`] does.
    ///
    /// # Errors
    /// As [`check`](Self::check).
    pub fn create_partial(&self, name: &str) -> Result<FolderFile> {
        let path = self.file_path(name)?;
        self.inner
            .policy
            .checked_in(&path, name, &self.state().listing)?;
        Ok(FolderFile {
            file: self.inner.policy.create_checked_partial(&path)?,
            folder: self.clone(),
            name: name.to_owned(),
        })
    }

    /// Writes a file as a whole or not at all.
    ///
    /// # Errors
    /// As [`check`](Self::check), and if writing fails.
    pub fn write(
        &self,
        name: &str,
        write: impl FnOnce(&mut FolderFile) -> io::Result<()>,
    ) -> Result<()> {
        let mut file = self.create(name)?;
        write(&mut file).map_err(OutputError::io("write", file.file.path()))?;
        file.commit()
    }

    /// Writes `bytes` to a file as a whole or not at all.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_bytes(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.write(name, |file| file.write_all(bytes))
    }

    /// Lists a file that other code of the program has written into the folder, after [`check`](Self::check) allowed
    /// it.
    ///
    /// # Errors
    /// [`OutputError::Io`] if the file cannot be read or the list not be written; [`OutputError::BadName`].
    pub fn record(&self, name: &str) -> Result<()> {
        let path = self.file_path(name)?;
        let hash = File::open(&path)
            .and_then(|mut file| hash_of(&mut file))
            .map_err(OutputError::io("read", &path))?;
        self.note(name, hash)?;
        self.state().listing.settle(name, hash);
        Ok(())
    }

    /// Removes the files of earlier runs whose name `remove` selects and that this run did not write. Files that were
    /// changed since, and files that the program did not write, stay.
    ///
    /// # Errors
    /// [`OutputError::Io`] if a file cannot be removed, and [`OutputError::ReplacesInput`] if it is an input.
    pub fn prune(&self, remove: impl Fn(&str) -> bool) -> Result<()> {
        let mut state = self.state();
        let old: Vec<String> = state
            .listing
            .names()
            .filter(|name| remove(name) && !state.written.contains(*name))
            .map(ToOwned::to_owned)
            .collect();
        for name in &old {
            let path = self.file_path(name)?;
            // A link is not ours even if the file behind it has the content that we wrote.
            let is_file = fs::symlink_metadata(&path).is_ok_and(|metadata| metadata.is_file());
            if is_file && state.listing.owns(name, &path)? {
                self.inner.policy.check_not_input(&path)?;
                fs::remove_file(&path).map_err(OutputError::io("remove", &path))?;
            }
        }
        state
            .listing
            .retain(|name| !old.iter().any(|removed| removed == name))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // The list is on disk before anything can panic.
        self.inner
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn note(&self, name: &str, hash: blake3::Hash) -> Result<()> {
        let mut state = self.state();
        state.listing.add(name, hash)?;
        state.written.insert(name.to_owned());
        Ok(())
    }

    /// The path of a file in the folder, for a name that cannot leave it.
    fn file_path(&self, name: &str) -> Result<PathBuf> {
        let mut components = Path::new(name).components();
        let is_one_name = matches!(
            (components.next(), components.next()),
            (Some(Component::Normal(part)), None) if part == name
        );
        if !is_one_name || name == LISTING_NAME || name.contains('\0') {
            return Err(OutputError::BadName {
                name: name.to_owned(),
            });
        }
        Ok(self.inner.path.join(name))
    }
}

/// A file of an [`OutputFolder`] being written; see [`AtomicFile`].
#[derive(Debug)]
pub struct FolderFile {
    // Dropped before the folder, which may then be empty.
    file: AtomicFile,
    folder: OutputFolder,
    name: String,
}

impl FolderFile {
    /// The path that is written.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Completes the file and lists it.
    ///
    /// # Errors
    /// [`OutputError`]; the file at the path is then as it was before.
    pub fn commit(self) -> Result<()> {
        let Self { folder, name, file } = self;
        let mut listed = None;
        file.commit_after(|hash| {
            listed = Some(hash);
            folder.note(&name, hash)
        })?;
        if let Some(hash) = listed {
            folder.state().listing.settle(&name, hash);
        }
        Ok(())
    }
}

impl Write for FolderFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for FolderFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

/// The folders of a path that are not there, the innermost first.
fn missing_folders(path: &Path) -> Vec<PathBuf> {
    path.ancestors()
        .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists())
        .map(Path::to_owned)
        .collect()
}

/// Locks a folder for this process until the file is dropped. The system lets go of it when the process ends, however it
/// ends.
#[cfg(unix)]
fn lock(path: &Path) -> Result<Option<File>> {
    let folder = File::open(path).map_err(OutputError::io("open the folder", path))?;
    match folder.try_lock() {
        Ok(()) => Ok(Some(folder)),
        Err(fs::TryLockError::WouldBlock) => Err(OutputError::InUse {
            path: path.to_owned(),
        }),
        // The file system has no locks.
        Err(fs::TryLockError::Error(_)) => Ok(None),
    }
}

/// Folders cannot be locked on this system.
#[cfg(not(unix))]
#[expect(clippy::unnecessary_wraps, reason = "as where they can")]
fn lock(_: &Path) -> Result<Option<File>> {
    Ok(None)
}
