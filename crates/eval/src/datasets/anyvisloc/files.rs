//! The files of a scene of AnyVisLoc.

use std::path::{Path, PathBuf};

/// Returns whether a folder has the files of a scene.
#[must_use]
pub fn is_scene(folder: &Path) -> bool {
    reference_file(folder).is_some()
}

/// `L??_reference.json`.
pub(super) fn reference_file(folder: &Path) -> Option<PathBuf> {
    files_of(folder)
        .into_iter()
        .find(|path| name_of(path).starts_with('L') && name_of(path).ends_with("_reference.json"))
}

/// The files of a folder, sorted; empty if the folder cannot be read.
pub(super) fn files_of(folder: &Path) -> Vec<PathBuf> {
    let entries = fs_err::read_dir(folder).into_iter().flatten();
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    files
}

pub(super) fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}
