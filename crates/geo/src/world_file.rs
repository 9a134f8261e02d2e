//! World files, six numbers beside a picture, and the coordinate systems beside those.

use std::path::{Path, PathBuf};

use crate::stated_crs::StatedCrs;
use crate::text_file::read_text;
use crate::{Affine, GeoError};

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
    endings.iter().find_map(|ending| beside(picture, ending))
}

/// The file beside a picture with another ending, in small or in capital letters, if there is one.
fn beside(picture: &Path, ending: &str) -> Option<PathBuf> {
    [ending.to_string(), ending.to_ascii_uppercase()]
        .into_iter()
        .map(|ending| picture.with_extension(ending))
        .find(|path| path.is_file())
}

/// The coordinate system beside a picture (ESRI's `map.prj` beside `map.jpg` and `map.jgw`), if there is one.
pub(crate) fn find_prj(picture: &Path) -> Option<PathBuf> {
    beside(picture, "prj")
}

/// Reads what [`find_prj`] found.
pub(crate) fn read_prj(path: &Path) -> Result<StatedCrs, GeoError> {
    let text = read_text(path, || GeoError::damaged(path, "it is not UTF-8 text"))?;
    Ok(StatedCrs::from_text(&text))
}

/// Reads a world file. Its six numbers give the *centre* of the top-left pixel (ESRI); the
/// transform is moved to that pixel's corner.
pub(crate) fn read_world_file(path: &Path) -> Result<Affine, GeoError> {
    let text = read_text(path, || bad(path, "it is not UTF-8 text"))?;
    let numbers: Vec<f64> = text
        .split_whitespace()
        .map(|word| {
            // As programs write it where the comma is the decimal sign, and as GDAL reads it.
            word.replace(',', ".")
                .parse()
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
