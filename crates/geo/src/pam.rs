//! What GDAL keeps beside a picture (PAM, `map.tif.aux.xml`): georeference and the value of pixels without data.

use std::path::{Path, PathBuf};

use crate::wkt::crs_from_text;
use crate::xml_tree::{Element, read_xml};
use crate::{Affine, Crs, GeoError};

/// The parts of a PAM file that are used; statistics, histograms and metadata are not.
#[derive(Debug, Default)]
pub(crate) struct Pam {
    pub affine: Option<Affine>,
    pub crs: Option<Crs>,
    /// If all bands have the same.
    pub nodata: Option<f64>,
}

/// The PAM file of a picture, if there is one.
pub(crate) fn find_pam(picture: &Path) -> Option<PathBuf> {
    let mut name = picture.as_os_str().to_os_string();
    name.push(".aux.xml");
    let path = PathBuf::from(name);
    path.is_file().then_some(path)
}

/// Reads the PAM file of a picture; empty if there is none.
pub(crate) fn read_pam(picture: &Path) -> Result<Pam, GeoError> {
    let Some(path) = find_pam(picture) else {
        return Ok(Pam::default());
    };
    let root = read_xml(&path)?;
    if root.name != "PAMDataset" {
        // Other programs use the name as well.
        return Ok(Pam::default());
    }
    let affine = match root.child_text("GeoTransform") {
        Some(text) => Some(affine_of(&path, text)?),
        None => None,
    };
    let crs = match root.child_text("SRS") {
        Some(text) if !text.is_empty() => crs_from_text(text, &path)?,
        _ => None,
    };
    Ok(Pam {
        affine,
        crs,
        nodata: nodata_of(&root),
    })
}

/// Six numbers with commas between them, GDAL's geotransform.
pub(crate) fn affine_of(path: &Path, text: &str) -> Result<Affine, GeoError> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|word| word.trim().parse().ok())
        .collect();
    let numbers = <[f64; 6]>::try_from(numbers)
        .map_err(|_| GeoError::damaged(path, "GeoTransform is not six numbers"))?;
    Affine::from_gdal(numbers).map_err(|e| e.in_file(path))
}

fn nodata_of(root: &Element) -> Option<f64> {
    let mut values = root
        .all("PAMRasterBand")
        .map(|band| band.child_text("NoDataValue")?.parse::<f64>().ok());
    let first = values.next()??;
    values.all(|value| value == Some(first)).then_some(first)
}
