//! Texts in files.

use std::path::Path;

use crate::GeoError;

/// What some editors write before a text in UTF-8.
pub(crate) const BYTE_ORDER_MARK: char = '\u{feff}';

/// The text of a file, without the mark. `not_utf8` is the error about a file that is no text in UTF-8.
pub(crate) fn read_text(
    path: &Path,
    not_utf8: impl FnOnce() -> GeoError,
) -> Result<String, GeoError> {
    let mut text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => not_utf8(),
        _ => GeoError::io(path, e),
    })?;
    let marks = text.len() - text.trim_start_matches(BYTE_ORDER_MARK).len();
    text.drain(..marks);
    Ok(text)
}
