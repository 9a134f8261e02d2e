//! Input files before they are opened.

use std::path::Path;

use anyhow::{Result, bail};

/// Checks that an input is a file that can be read from any position: opening a FIFO would wait for a writer, and a
/// device may never end. What is missing is left to the reader, which says what it looked for.
///
/// # Errors
/// The path is that of something else.
pub fn check_regular(path: &Path) -> Result<()> {
    match fs_err::metadata(path) {
        Ok(metadata) if metadata.is_dir() => {
            bail!("{}: is a folder; expected a file", path.display())
        }
        Ok(metadata) if !metadata.is_file() => bail!(
            "{}: is a pipe or a device; expected a file: save it to a file first",
            path.display()
        ),
        _ => Ok(()),
    }
}
