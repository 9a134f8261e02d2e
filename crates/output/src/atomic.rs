//! Files that are replaced as a whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read as _, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::aside;
use crate::error::{OutputError, Result, WriteFailed};
use crate::inputs::Inputs;
use crate::target::{Place, Snapshot, TargetKind};

/// A file being written: it appears at its path when [`commit`](Self::commit) succeeds, complete and synced to disk. If
/// it is dropped before, what was at the path stays as it was.
///
/// A device, pipe or FIFO is written through as bytes come. A symbolic link is followed. A new file gets the access
/// rights that the umask leaves; a replaced one keeps its own and, where the system allows, its owner. Errors of [`Write`] name the file.
#[derive(Debug)]
pub struct AtomicFile {
    /// The path as given, for messages.
    path: PathBuf,
    out: BufWriter<File>,
    /// `None` if the bytes are written through.
    aside: Option<Aside>,
    /// What it may not replace.
    inputs: Inputs,
}

#[derive(Debug)]
struct Aside {
    path: PathBuf,
    place: Place,
    /// What stood at the place when it was checked; `None` if it is replaced whatever it is.
    checked: Option<Snapshot>,
    /// Whether the file stays if it is not committed.
    keep: bool,
    committed: bool,
}

impl AtomicFile {
    /// Begins to write `path`, replacing whatever file is there at the end. Check the path with an
    /// [`OutputPolicy`](crate::OutputPolicy) first, unless the file is known to be the program's own.
    ///
    /// # Errors
    /// [`OutputError`] if the path is that of a folder, its folder is missing, or no file can be created there.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        Self::begin(path.as_ref(), None, aside::create_hidden)
    }

    /// Begins to write a long output whose beginning is worth something: the bytes go to `NAME.partial` beside it (or
    /// `NAME.partial-2` if that exists), which stays if the process is killed or the work fails.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn create_partial(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let checked = Snapshot::of(path).map_err(OutputError::io("examine", path))?;
        let mut file = Self::begin(path, Some(checked), aside::create_partial)?;
        if let Some(aside) = &mut file.aside {
            aside.keep = true;
        }
        Ok(file)
    }

    /// Begins to write a file that was checked when it was as `checked` says.
    pub(crate) fn create_checked(path: &Path, checked: Snapshot) -> Result<Self> {
        Self::begin(path, Some(checked), aside::create_hidden)
    }

    /// This file, whose commit fails if what it would replace has become one of `inputs` by then.
    pub(crate) fn sparing(mut self, inputs: &Inputs) -> Self {
        self.inputs = inputs.clone();
        self
    }

    fn begin(
        path: &Path,
        checked: Option<Snapshot>,
        create: fn(&Place) -> io::Result<(File, PathBuf)>,
    ) -> Result<Self> {
        let given = path.to_owned();
        match TargetKind::of(path)? {
            TargetKind::Folder => Err(OutputError::IsFolder { path: given }),
            TargetKind::Stream => {
                let file = OpenOptions::new()
                    .append(true)
                    .open(path)
                    .map_err(OutputError::io("open", path))?;
                Ok(Self {
                    path: given,
                    out: BufWriter::new(file),
                    aside: None,
                    inputs: Inputs::default(),
                })
            }
            TargetKind::Absent | TargetKind::File => {
                let place = Place::of(path)?;
                let (file, aside) =
                    create(&place).map_err(OutputError::io("create a temporary file for", path))?;
                Ok(Self {
                    path: given,
                    out: BufWriter::new(file),
                    aside: Some(Aside {
                        path: aside,
                        place,
                        checked,
                        keep: false,
                        committed: false,
                    }),
                    inputs: Inputs::default(),
                })
            }
        }
    }

    /// The path that is written, as given.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the bytes are until the file is complete; `None` if they are written through.
    #[must_use]
    pub fn partial_path(&self) -> Option<&Path> {
        self.aside.as_ref().map(|aside| aside.path.as_path())
    }

    /// Cuts the file back to its first `len` bytes and continues behind them, after a failed write: what is still in memory is given up.
    ///
    /// # Errors
    /// [`OutputError`] if the file cannot be cut.
    pub fn cut_back(&mut self, len: u64) -> Result<()> {
        let cut = |out: &mut BufWriter<File>| {
            let mut file = out.get_ref().try_clone()?;
            file.set_len(len)?;
            file.seek(SeekFrom::Start(len))?;
            // Without writing what it holds.
            let _ = std::mem::replace(out, BufWriter::new(file)).into_parts();
            Ok(())
        };
        cut(&mut self.out).map_err(OutputError::io("cut", &self.path))
    }

    /// Completes the file: flushes, syncs to disk, renames into place.
    ///
    /// # Errors
    /// [`OutputError`]; the file at the path is then as it was before.
    pub fn commit(self) -> Result<()> {
        self.commit_after(|_| Ok(()))
    }

    /// As [`commit`](Self::commit), with a step just before the renaming that gets the BLAKE3 hash of the content; not
    /// called for a stream.
    pub(crate) fn commit_after(
        mut self,
        before_renaming: impl FnOnce(blake3::Hash) -> Result<()>,
    ) -> Result<()> {
        self.out
            .flush()
            .map_err(OutputError::io("write", &self.path))?;
        let Some(aside) = &mut self.aside else {
            return Ok(());
        };
        self.inputs.check(&self.path)?;
        let file = self.out.get_mut();
        let replaced = aside.place.path();
        take_access_rights(file, &replaced);
        file.sync_all()
            .map_err(OutputError::io("sync to disk", &self.path))?;
        let hash = hash_of(file).map_err(OutputError::io("read back", &self.path))?;
        if let Some(checked) = &aside.checked {
            checked.check(&replaced, &self.path)?;
        }
        before_renaming(hash)?;
        fs::rename(&aside.path, &replaced)
            .map_err(OutputError::io("rename a temporary file to", &self.path))?;
        aside.committed = true;
        sync_folder(&aside.place.folder);
        Ok(())
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        let Some(aside) = &self.aside else { return };
        if aside.committed {
            return;
        }
        // A partial file that holds nothing is worth nothing.
        let _ = self.out.flush();
        let empty = fs::metadata(&aside.path).is_ok_and(|metadata| metadata.len() == 0);
        if !aside.keep || empty {
            // There is nothing left to do if it stays.
            let _ = fs::remove_file(&aside.path);
        }
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out
            .write(bytes)
            .map_err(|error| WriteFailed::wrap(&self.path, error))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out
            .flush()
            .map_err(|error| WriteFailed::wrap(&self.path, error))
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.out
            .seek(position)
            .map_err(|error| WriteFailed::wrap(&self.path, error))
    }
}

/// Writes a file as a whole or not at all; see [`AtomicFile`].
///
/// # Errors
/// [`OutputError`]; what was at the path then stays as it was.
pub fn write_atomic(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut AtomicFile) -> io::Result<()>,
) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    write(&mut file).map_err(OutputError::io("write", &file.path))?;
    file.commit()
}

/// Writes `bytes` to a file as a whole or not at all; see [`AtomicFile`].
///
/// # Errors
/// As [`write_atomic`].
pub fn write_bytes_atomic(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    write_atomic(path, |file| file.write_all(bytes))
}

/// Puts a file that is completely written in the place of `path`, in the same folder: syncs it to disk and renames it.
/// For writers that keep a temporary file of their own, such as a build that can be resumed; others use [`AtomicFile`]. A replaced
/// file keeps its access rights and, where the system allows, its owner. `checked` is how the path looked before the work, when what
/// stood there was allowed to be replaced.
///
/// # Errors
/// [`OutputError`] if the path is that of a folder, device or pipe, what stands there is not what was `checked`, or the system
/// refuses a step; what was at the path then stays as it was.
pub fn rename_into_place(
    written: impl AsRef<Path>,
    path: impl AsRef<Path>,
    checked: &Snapshot,
) -> Result<()> {
    let (written, path) = (written.as_ref(), path.as_ref());
    match TargetKind::of(path)? {
        TargetKind::Folder => {
            return Err(OutputError::IsFolder {
                path: path.to_owned(),
            });
        }
        TargetKind::Stream => {
            let kind = io::Error::new(io::ErrorKind::InvalidInput, "it is a device or pipe");
            return Err(OutputError::io("replace", path)(kind));
        }
        TargetKind::Absent | TargetKind::File => {}
    }
    let file = File::open(written).map_err(OutputError::io("open", written))?;
    let place = Place::of(path)?;
    take_access_rights(&file, &place.path());
    file.sync_all()
        .map_err(OutputError::io("sync to disk", written))?;
    checked.check(&place.path(), path)?;
    fs::rename(written, place.path())
        .map_err(OutputError::io("rename a temporary file to", path))?;
    sync_folder(&place.folder);
    Ok(())
}

/// Gives a file the owner, as far as the system allows, and the access rights of the one that it is going to replace, if there
/// is one.
fn take_access_rights(file: &File, replaced: &Path) {
    if let Ok(metadata) = fs::metadata(replaced) {
        #[cfg(unix)]
        take_owner(file, &metadata);
        // Not every file system keeps access rights, and the content is what counts.
        let _ = file.set_permissions(metadata.permissions());
    }
}

/// So that what root replaces stays readable by whom it belongs to. Others may only give files to their own groups.
#[cfg(unix)]
fn take_owner(file: &File, replaced: &fs::Metadata) {
    use std::os::unix::fs::{MetadataExt as _, fchown};
    let _ = fchown(file, None, Some(replaced.gid()));
    let _ = fchown(file, Some(replaced.uid()), None);
}

/// BLAKE3 of a whole file.
pub(crate) fn hash_of(file: &mut File) -> io::Result<blake3::Hash> {
    file.seek(SeekFrom::Start(0))?;
    let mut hasher = blake3::Hasher::new();
    let mut block = vec![0; 1 << 16];
    loop {
        match file.read(&mut block) {
            Ok(0) => return Ok(hasher.finalize()),
            Ok(len) => {
                hasher.update(&block[..len]);
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// Makes a renaming last through a power failure; not every system can, and the file is whole either way.
pub(crate) fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}
