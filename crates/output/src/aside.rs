//! Temporary files beside the file that they will become.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use crate::target::{Identity, Place};

/// Ending of hidden temporary files. One that a killed process left is removed by the next writer of the same file.
const HIDDEN_ENDING: &str = ".grim-tmp";

/// Ending of partial outputs that are kept if the process is killed.
pub(crate) const PARTIAL_ENDING: &str = ".partial";

/// Longest file name, bytes, on common file systems (ext4, NTFS, APFS).
const MAX_NAME_LEN: usize = 255;

/// Most names that are looked at before giving up.
const MAX_NAMES: usize = 1000;

/// Creates a hidden temporary file beside `place` for this process alone, with the access rights that a new file gets
/// (umask applies).
pub(crate) fn create_hidden(place: &Place) -> io::Result<(File, PathBuf)> {
    for number in 0..MAX_NAMES {
        let path = place.folder.join(hidden_name(&place.name, number));
        match create_new(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && remove_stale(&path) => {}
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
            Err(error) => return Err(error),
            Ok(file) if claim(&file, &path) => return Ok((file, path)),
            Ok(_) => continue,
        }
        if let Ok(file) = create_new(&path)
            && claim(&file, &path)
        {
            return Ok((file, path));
        }
    }
    Err(too_many())
}

/// Creates a visible partial file beside `place`: `NAME.partial`, or `NAME.partial-2` and so on if there are earlier
/// ones, which are never touched.
pub(crate) fn create_partial(place: &Place) -> io::Result<(File, PathBuf)> {
    for number in 1..=MAX_NAMES {
        let mut name = place.name.clone();
        name.push(PARTIAL_ENDING);
        if number > 1 {
            name.push(format!("-{number}"));
        }
        let path = place.folder.join(name);
        match create_new(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
            Ok(file) => return Ok((file, path)),
        }
    }
    Err(too_many())
}

/// Removes the hidden temporary files of processes that no longer run.
pub(crate) fn sweep(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.as_encoded_bytes();
        let ours = HIDDEN_ENDING.as_bytes();
        if name.starts_with(b".") && name.windows(ours.len()).any(|part| part == ours) {
            remove_stale(&entry.path());
        }
    }
}

fn too_many() -> io::Error {
    io::Error::other("too many temporary files of the same name; remove them first")
}

fn hidden_name(name: &OsStr, number: usize) -> OsString {
    let mut hidden = OsString::from(".");
    if name.len() + 20 > MAX_NAME_LEN {
        let hash = blake3::hash(name.as_encoded_bytes()).to_hex();
        hidden.push(&hash.as_str()[..32]);
    } else {
        hidden.push(name);
    }
    hidden.push(HIDDEN_ENDING);
    if number > 0 {
        hidden.push(format!("-{number}"));
    }
    hidden
}

fn create_new(path: &Path) -> io::Result<File> {
    OpenOptions::new()
        .read(true)
        .write(true)
        .create_new(true)
        .open(path)
}

/// Locks a new temporary file, so that others see that its writer lives. `false` if another process took it for stale
/// and removed it between its creation and the lock.
fn claim(file: &File, path: &Path) -> bool {
    match file.try_lock() {
        Ok(()) => is_still(file, path),
        Err(fs::TryLockError::WouldBlock) => false,
        // The file system has no locks: then nobody takes it for stale either.
        Err(fs::TryLockError::Error(_)) => true,
    }
}

/// Removes a temporary file if its writer no longer runs, which the lock tells; `true` if it is gone.
///
/// Only the name is removed, nothing is truncated: a hard link elsewhere keeps its content.
fn remove_stale(path: &Path) -> bool {
    if !fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_file()) {
        return false;
    }
    File::open(path).is_ok_and(|file| {
        file.try_lock().is_ok() && is_still(&file, path) && fs::remove_file(path).is_ok()
    })
}

/// Whether `path` still names the opened `file`.
fn is_still(file: &File, path: &Path) -> bool {
    let opened = file
        .metadata()
        .and_then(|metadata| Identity::from_metadata(&metadata, path));
    matches!((opened, Identity::of(path)), (Ok(a), Ok(b)) if a == b)
}
