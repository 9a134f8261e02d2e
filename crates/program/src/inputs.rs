//! Input files before they are opened.

use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Result, bail};

/// Checks that an input is a file that can be read from any position: opening a FIFO would wait for a writer, and a
/// device may never end.
///
/// # Errors
/// Nothing is there, or something else than a file.
pub fn check_regular(path: &Path) -> Result<()> {
    // Not `fs_err`: the path is stated once.
    match std::fs::metadata(path) {
        Err(error) => {
            let advice = match error.kind() {
                ErrorKind::NotFound => "; check the path",
                _ => "",
            };
            bail!("cannot read {}: {error}{advice}", path.display())
        }
        Ok(metadata) if metadata.is_dir() => {
            bail!("{}: is a folder; expected a file", path.display())
        }
        Ok(metadata) if !metadata.is_file() => bail!(
            "{}: is a pipe or a device; expected a file: save it to a file first",
            path.display()
        ),
        Ok(_) => Ok(()),
    }
}

/// Checks that a map is a file that can be read from any position, or a folder.
///
/// # Errors
/// Nothing is there, or a pipe or device.
pub fn check_map(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    check_regular(path)
}
