//! World files, six numbers beside a picture, and the coordinate systems beside those.

use std::path::{Path, PathBuf};

use crate::stated_crs::StatedCrs;
use crate::{Affine, GeoError};

/// What some editors write before a text in UTF-8.
pub(crate) const BYTE_ORDER_MARK: char = '\u{feff}';

/// The world file of a picture, if there is one: `map.jgw`, `map.jpgw` or `map.wld` beside
/// `map.jpg`, in any case.
pub(crate) fn find_world_file(picture: &Path) -> Option<PathBuf> {
    let extension = picture.extension()?.to_str()?.to_ascii_lowercase();
    let mut endings = Vec::new();
    if let (Some(first), Some(last)) = (extension.chars().next(), extension.chars().last()) {
        endings.push(format!("{first}{last}w"));
    }
    endings.push(format!("{extension}w"));
    endings.push("wld".to_string());
    endings
        .iter()
        .flat_map(|e| [e.clone(), e.to_ascii_uppercase()])
        .map(|e| picture.with_extension(e))
        .find(|path| path.is_file())
}

/// The coordinate system beside a picture (ESRI's `map.prj` beside `map.jpg` and `map.jgw`), if there is one.
pub(crate) fn find_prj(picture: &Path) -> Option<PathBuf> {
    ["prj", "PRJ"]
        .map(|ending| picture.with_extension(ending))
        .into_iter()
        .find(|path| path.is_file())
}

/// Reads what [`find_prj`] found.
pub(crate) fn read_prj(path: &Path) -> Result<StatedCrs, GeoError> {
    let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => GeoError::damaged(path, "it is not UTF-8 text"),
        _ => GeoError::io(path, e),
    })?;
    Ok(StatedCrs::from_text(
        text.trim_start_matches(BYTE_ORDER_MARK),
    ))
}

/// Reads a world file. Its six numbers give the *centre* of the top-left pixel (ESRI); the
/// transform is moved to that pixel's corner.
pub(crate) fn read_world_file(path: &Path) -> Result<Affine, GeoError> {
    let text = std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => bad(path, "it is not UTF-8 text"),
        _ => GeoError::io(path, e),
    })?;
    let numbers: Vec<f64> = text
        .trim_start_matches(BYTE_ORDER_MARK)
        .split_whitespace()
        .map(|word| {
            word.parse()
                .map_err(|_| bad(path, &format!("'{word}' is not a number")))
        })
        .collect::<Result<_, _>>()?;
    let [
        x_from_col,
        y_from_col,
        x_from_row,
        y_from_row,
        centre_x,
        centre_y,
    ] = numbers[..]
    else {
        return Err(bad(path, &format!("{} numbers", numbers.len())));
    };
    Affine::from_gdal([
        centre_x - 0.5 * (x_from_col + x_from_row),
        x_from_col,
        x_from_row,
        centre_y - 0.5 * (y_from_col + y_from_row),
        y_from_col,
        y_from_row,
    ])
    .map_err(|_| bad(path, "its transform has no inverse"))
}

fn bad(path: &Path, reason: &str) -> GeoError {
    GeoError::BadWorldFile {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    }
}
