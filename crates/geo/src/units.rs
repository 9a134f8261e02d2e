//! Units of coordinates and parameters: those of GeoKeys, and as PROJ parameters.

use geotiff_core::geokeys::{self as ids, GeoKeyDirectory};

/// OGC GeoTIFF 1.1: the value that means "described by parameters".
pub(crate) const USER_DEFINED: u16 = 32767;
/// GeogAngularUnitSizeGeoKey: radians per unit.
const KEY_ANGULAR_UNIT_SIZE: u16 = 2055;
/// ProjLinearUnitSizeGeoKey: metres per unit.
const KEY_LINEAR_UNIT_SIZE: u16 = 3077;

/// Two unit sizes that differ by less than this share are the same unit.
const SAME_UNIT: f64 = 1e-9;

/// EPSG codes of geographic coordinate systems in grads: all are counted from Paris. The list of definitions does not
/// give the unit.
const GEOGRAPHIC_IN_GRADS: [u32; 9] = [4807, 4810, 4811, 4816, 4819, 4821, 4901, 4902, 7400];

/// Degrees per coordinate unit of a geographic coordinate system with an EPSG code.
pub(crate) fn degrees_per_unit_of_epsg(code: u32) -> f64 {
    if GEOGRAPHIC_IN_GRADS.contains(&code) {
        0.9
    } else {
        1.0
    }
}

/// Degrees per angular unit of GeogAngularUnitsGeoKey. `None` if the file does not give the unit.
///
/// # Errors
/// Returns a description of a unit that cannot be converted, such as sexagesimal notation.
pub(crate) fn degrees_per_angular_unit(keys: &GeoKeyDirectory) -> Result<Option<f64>, String> {
    // EPSG unit codes; 9122 is "degree (supplier to define representation)".
    match keys.get_short(ids::GEOG_ANGULAR_UNITS) {
        None | Some(0) => Ok(None),
        Some(9102 | 9122) => Ok(Some(1.0)),
        Some(9101) => Ok(Some(1_f64.to_degrees())),
        Some(9103) => Ok(Some(1.0 / 60.0)),
        Some(9104) => Ok(Some(1.0 / 3600.0)),
        Some(9105 | 9106) => Ok(Some(0.9)),
        Some(USER_DEFINED) => match size(keys, KEY_ANGULAR_UNIT_SIZE) {
            Some(radians) => Ok(Some(radians.to_degrees())),
            None => Err("a user-defined angular unit without a positive size".to_string()),
        },
        Some(other) => Err(format!(
            "angular unit EPSG:{other}; supported are degree, radian, grad, arc-minute, arc-second and units with a size"
        )),
    }
}

/// Metres per linear unit of ProjLinearUnitsGeoKey. `None` if the file does not give the unit.
///
/// # Errors
/// Returns a description of a unit that cannot be converted.
pub(crate) fn metres_per_linear_unit(keys: &GeoKeyDirectory) -> Result<Option<f64>, String> {
    // EPSG unit codes: metre, foot, US survey foot, Clarke's foot, kilometre.
    match keys.get_short(ids::PROJ_LINEAR_UNITS) {
        None | Some(0) => Ok(None),
        Some(9001) => Ok(Some(1.0)),
        Some(9002) => Ok(Some(0.3048)),
        Some(9003) => Ok(Some(1200.0 / 3937.0)),
        Some(9005) => Ok(Some(0.304_797_265_4)),
        Some(9036) => Ok(Some(1000.0)),
        Some(USER_DEFINED) => match size(keys, KEY_LINEAR_UNIT_SIZE) {
            Some(metres) => Ok(Some(metres)),
            None => Err("a user-defined linear unit without a positive size".to_string()),
        },
        Some(other) => Err(format!(
            "linear unit EPSG:{other}; supported are metre, kilometre, foot, US survey foot and units with a size"
        )),
    }
}

/// A linear unit, in metres, as a PROJ parameter.
pub(crate) fn proj_units(unit_m: f64) -> String {
    if unit_m == 1.0 {
        "+units=m".to_string()
    } else if is_same_unit(unit_m, 0.3048) {
        "+units=ft".to_string()
    } else if is_same_unit(unit_m, 1200.0 / 3937.0) {
        "+units=us-ft".to_string()
    } else {
        format!("+to_meter={unit_m}")
    }
}

/// Whether two unit sizes are the same unit.
pub(crate) fn is_same_unit(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < SAME_UNIT
}

fn size(keys: &GeoKeyDirectory, key: u16) -> Option<f64> {
    let size = *keys.get_double(key)?.first()?;
    (size.is_finite() && size > 0.0).then_some(size)
}
