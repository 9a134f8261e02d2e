//! What GDAL keeps beside a picture (PAM, `map.tif.aux.xml`): georeference and the value of pixels without data.

use std::path::{Path, PathBuf};

use crate::sidecar_values::SidecarValues;
use crate::stated_crs::StatedCrs;
use crate::xml_tree::{Element, read_xml};
use crate::{Affine, GeoError};

/// The name of the PAM file of a picture.
pub(crate) fn pam_path(picture: &Path) -> PathBuf {
    let mut name = picture.as_os_str().to_os_string();
    name.push(".aux.xml");
    PathBuf::from(name)
}

/// The PAM file of a picture, if there is one.
pub(crate) fn find_pam(picture: &Path) -> Option<PathBuf> {
    Some(pam_path(picture)).filter(|path| path.is_file())
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
    Ok(SidecarValues {
        affine,
        crs: StatedCrs::from_text(root.child_text("SRS").unwrap_or_default()),
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
