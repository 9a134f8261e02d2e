//! Writing the files of a run.

use crate::error::TrainError;
use std::path::Path;

/// Writes a file atomically and creates its folder if necessary.
///
/// # Errors
/// [`TrainError::Io`] if the folder cannot be created, [`TrainError::Output`] if the file cannot be written.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        fs_err::create_dir_all(folder)?;
    }
    Ok(grimnet_output::write_bytes_atomic(path, bytes)?)
}
