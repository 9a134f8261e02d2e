//! Which existing files an output may replace.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::Path;

use crate::aside;
use crate::atomic::AtomicFile;
use crate::error::{OutputError, Result};
use crate::inputs::Inputs;
use crate::listing::Listing;
use crate::target::{Place, Snapshot, TargetKind};

/// Which existing files a run may replace: never an input of its own, otherwise only files of this program unless
/// overwriting is allowed. Clones share the inputs.
#[derive(Debug, Clone, Default)]
pub struct OutputPolicy {
    overwrite: bool,
    inputs: Inputs,
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
    pub fn protect_all(self, inputs: impl IntoIterator<Item = impl AsRef<Path>>) -> Self {
        self.add_inputs(inputs);
        self
    }

    /// Protects inputs, and every file below those that are folders.
    #[must_use]
    pub fn protect_trees(self, inputs: impl IntoIterator<Item = impl AsRef<Path>>) -> Self {
        self.add_input_trees(inputs);
        self
    }

    /// As [`protect_all`](Self::protect_all), for inputs that become known during the run: all clones of this policy, and
    /// the files that are being written under it, spare them from now on.
    pub fn add_inputs(&self, inputs: impl IntoIterator<Item = impl AsRef<Path>>) {
        for input in inputs {
            self.inputs.add(input.as_ref());
        }
    }

    /// As [`protect_trees`](Self::protect_trees), for inputs that become known during the run.
    pub fn add_input_trees(&self, inputs: impl IntoIterator<Item = impl AsRef<Path>>) {
        for input in inputs {
            self.inputs.add_tree(input.as_ref());
        }
    }

    /// Checks that a file may be written: call it before long work. A file that starts with one of `magics` is the
    /// program's own.
    ///
    /// # Errors
    /// [`OutputError`] if the path is a folder, an input, a file of somebody else or one that is mounted by itself, or if its folder
    /// is missing or cannot be written.
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
    /// somebody else before it is committed, the commit fails with [`OutputError::Changed`]; if it has become an input by
    /// then, with [`OutputError::ReplacesInput`].
    ///
    /// # Errors
    /// As [`check_file`](Self::check_file).
    pub fn create(&self, path: impl AsRef<Path>, magics: &[&[u8]]) -> Result<AtomicFile> {
        let path = path.as_ref();
        let snapshot = self.checked(path, magics)?;
        self.create_checked(path, snapshot)
    }

    /// Checks `path` and begins to write it as [`AtomicFile::create_partial`] does.
    ///
    /// # Errors
    /// As [`check_file`](Self::check_file).
    pub fn create_partial(&self, path: impl AsRef<Path>) -> Result<AtomicFile> {
        let path = path.as_ref();
        self.checked(path, &[])?;
        self.create_checked_partial(path)
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
        self.inputs.check(path.as_ref())
    }

    /// Begins to write a file that was checked when it was as `checked` says.
    pub(crate) fn create_checked(&self, path: &Path, checked: Snapshot) -> Result<AtomicFile> {
        Ok(AtomicFile::create_checked(path, checked)?.sparing(&self.inputs))
    }

    /// As [`create_partial`](Self::create_partial), of a file that was checked just now.
    pub(crate) fn create_checked_partial(&self, path: &Path) -> Result<AtomicFile> {
        Ok(AtomicFile::create_partial(path)?.sparing(&self.inputs))
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
                if is_mounted_alone(&Place::of(path)?.path()) {
                    let why = "it is mounted by itself, as a single file into a container, and a new file cannot take its \
                               place; mount its folder, or choose another output path";
                    let error = io::Error::new(io::ErrorKind::ResourceBusy, why);
                    return Err(OutputError::io("replace", path)(error));
                }
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

/// Whether a file is the root of a mount, which cannot be renamed over: told before the work, not at its end. `false` where
/// the system does not say.
#[cfg(target_os = "linux")]
fn is_mounted_alone(path: &Path) -> bool {
    let mounts = (mount_of(path), mount_of(crate::target::folder_of(path)));
    matches!(mounts, (Some(file), Some(folder)) if file != folder)
}

#[cfg(not(target_os = "linux"))]
fn is_mounted_alone(_: &Path) -> bool {
    false
}

/// Linux' number of the mount that a file or folder is on.
#[cfg(target_os = "linux")]
fn mount_of(path: &Path) -> Option<u64> {
    use std::os::fd::AsRawFd as _;
    let file = File::open(path).ok()?;
    let about = fs::read_to_string(format!("/proc/self/fdinfo/{}", file.as_raw_fd())).ok()?;
    let mount = about
        .lines()
        .find_map(|line| line.strip_prefix("mnt_id:"))?;
    mount.trim().parse().ok()
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
