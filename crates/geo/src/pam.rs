//! What GDAL keeps beside a picture (PAM, `map.tif.aux.xml`): georeference and the value of pixels without data.

use std::path::{Path, PathBuf};

use crate::sidecar_values::SidecarValues;
use crate::wkt::crs_from_text;
use crate::xml_tree::{Element, read_xml};
use crate::{Affine, GeoError};

/// The PAM file of a picture, if there is one.
pub(crate) fn find_pam(picture: &Path) -> Option<PathBuf> {
    let mut name = picture.as_os_str().to_os_string();
    name.push(".aux.xml");
    let path = PathBuf::from(name);
    path.is_file().then_some(path)
}

/// What the PAM file of a picture says; nothing if there is none. Statistics, histograms and metadata are not used, and a value of
/// pixels without data only if all bands have the same.
pub(crate) fn read_pam(picture: &Path) -> Result<SidecarValues, GeoError> {
    let Some(path) = find_pam(picture) else {
        return Ok(SidecarValues::default());
    };
    let root = read_xml(&path)?;
    if root.name != "PAMDataset" {
        // Other programs use the name as well.
        return Ok(SidecarValues::default());
    }
    let affine = match root.child_text("GeoTransform") {
        Some(text) => Some(affine_of(&path, text)?),
        None => None,
    };
    // One that is not known is none: the file or the options may give one that is.
    let crs = root
        .child_text("SRS")
        .filter(|text| !text.is_empty())
        .and_then(|text| crs_from_text(text, &path).ok().flatten());
    Ok(SidecarValues {
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
