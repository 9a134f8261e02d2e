//! Files that are whole or absent, whenever the process is killed.

use crate::error::TrainError;
use std::io::Write as _;
use std::path::Path;

/// Writes a file beside `path`, syncs it and renames it over `path`; makes the folder where there is none.
///
/// # Errors
/// [`TrainError::Io`].
pub(crate) fn write_aside(path: &Path, bytes: &[u8]) -> Result<(), TrainError> {
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    fs_err::create_dir_all(folder)?;
    let mut aside = tempfile::NamedTempFile::new_in(folder)?;
    aside.write_all(bytes)?;
    aside.as_file().sync_all()?;
    aside.persist(path).map_err(|error| error.error)?;
    Ok(())
}
