//! How the files are read that EVALUATION.md is made from.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

/// Why the page cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClaimError {
    /// A file or folder cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A file is no JSON of the expected form.
    #[error("{path}: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// An experiment's table cannot be read.
    #[error(transparent)]
    Table(#[from] crate::experiment_table::TableError),
}

/// Reads a file of JSON.
///
/// # Errors
/// The file cannot be read or is of another form.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, ClaimError> {
    serde_json::from_slice(&fs_err::read(path)?).map_err(|source| ClaimError::Json {
        path: path.to_owned(),
        source,
    })
}

/// The files and folders in a folder, in the order of their names.
///
/// # Errors
/// The folder cannot be read.
pub(crate) fn sorted(folder: &Path) -> Result<Vec<PathBuf>, ClaimError> {
    let mut paths: Vec<PathBuf> = fs_err::read_dir(folder)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    paths.sort();
    Ok(paths)
}
