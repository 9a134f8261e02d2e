//! The CRS that GeoKeys describe, by code or by parameters.

use std::path::Path;

use geotiff_core::geokeys::{self as ids, GeoKeyDirectory, GeoKeyValue};

use crate::datum_names::{epsg_under_projection, known_datum};
use crate::projection::{ProjectionMethod, ProjectionParameters};
use crate::units::{
    USER_DEFINED, degrees_per_angular_unit, degrees_per_unit_of_epsg, is_same_unit,
    metres_per_linear_unit, proj_units,
};
use crate::{Crs, GeoError};

/// GTModelTypeGeoKey: projected.
const MODEL_PROJECTED: u16 = 1;
/// GTModelTypeGeoKey: geographic.
const MODEL_GEOGRAPHIC: u16 = 2;
/// Web Mercator, which has no projection method of its own in GeoTIFF 1.0.
const WEB_MERCATOR: u32 = 3857;
/// What citations call it that ArcGIS and GDAL write in place of the code.
const WEB_MERCATOR_NAMES: [&str; 3] = [
    "Mercator_Auxiliary_Sphere",
    "Web_Mercator",
    "Pseudo-Mercator",
];

// Keys that the library does not name (OGC GeoTIFF 1.1, annex B).
const KEY_PRIME_MERIDIAN: u16 = 2051;
const KEY_ELLIPSOID: u16 = 2056;
const KEY_SEMI_MAJOR_AXIS: u16 = 2057;
const KEY_SEMI_MINOR_AXIS: u16 = 2058;
const KEY_INVERSE_FLATTENING: u16 = 2059;
const KEY_PRIME_MERIDIAN_LONGITUDE: u16 = 2061;
const KEY_TO_WGS84: u16 = 2062;
const KEY_STD_PARALLEL_1: u16 = 3078;
const KEY_STD_PARALLEL_2: u16 = 3079;
const KEY_NATURAL_ORIGIN_LON: u16 = 3080;
const KEY_NATURAL_ORIGIN_LAT: u16 = 3081;
const KEY_FALSE_EASTING: u16 = 3082;
const KEY_FALSE_NORTHING: u16 = 3083;
const KEY_FALSE_ORIGIN_LON: u16 = 3084;
const KEY_FALSE_ORIGIN_LAT: u16 = 3085;
const KEY_FALSE_ORIGIN_EASTING: u16 = 3086;
const KEY_FALSE_ORIGIN_NORTHING: u16 = 3087;
const KEY_CENTER_LON: u16 = 3088;
const KEY_CENTER_LAT: u16 = 3089;
const KEY_CENTER_EASTING: u16 = 3090;
const KEY_CENTER_NORTHING: u16 = 3091;
const KEY_SCALE_AT_NATURAL_ORIGIN: u16 = 3092;
const KEY_SCALE_AT_CENTER: u16 = 3093;
const KEY_STRAIGHT_VERTICAL_POLE_LON: u16 = 3095;

/// The CRS of a file and the unit of the file's coordinates in it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FileCrs {
    pub crs: Crs,
    /// Units of the CRS (degrees or the linear unit) per unit of the file's coordinates: not 1 for geographic
    /// coordinates in another angular unit.
    pub crs_units_per_file_unit: f64,
}

impl From<Crs> for FileCrs {
    fn from(crs: Crs) -> Self {
        Self {
            crs,
            crs_units_per_file_unit: 1.0,
        }
    }
}

/// The CRS of a file's GeoKeys.
pub(crate) fn crs_from_geokeys(keys: &GeoKeyDirectory, path: &Path) -> Result<FileCrs, GeoError> {
    let result = match keys.get_short(ids::GT_MODEL_TYPE) {
        Some(MODEL_GEOGRAPHIC) => geographic(keys),
        _ if is_named_web_mercator(keys) => Crs::from_epsg(WEB_MERCATOR)
            .map(FileCrs::from)
            .map_err(Problem::Crs),
        Some(MODEL_PROJECTED) | None => projected(keys),
        // Some writers leave the model type undefined and give a code all the same.
        Some(0 | USER_DEFINED)
            if keys
                .get_short(ids::PROJECTED_CRS_TYPE)
                .is_some_and(|c| c != 0) =>
        {
            projected(keys)
        }
        // Of a projection that GeoKeys cannot express GDAL writes the geographic system, and the rest in words.
        Some(0 | USER_DEFINED) if keys.get_ascii(ids::PROJ_CITATION).is_some() => Err(
            Problem::Unsupported("its GeoKeys do not express the projection".to_string()),
        ),
        Some(0 | USER_DEFINED) if code(keys, ids::GEODETIC_CRS_TYPE).is_some() => geographic(keys),
        Some(other) => Err(Problem::Unsupported(format!("model type {other}"))),
    };
    result.map_err(|problem| match problem {
        Problem::Missing => GeoError::MissingCrs {
            path: path.to_path_buf(),
            reason: "its GeoKeys do not say which".to_string(),
        },
        Problem::Unsupported(reason) => GeoError::UnsupportedCrs {
            path: path.to_path_buf(),
            crs: citation(keys),
            reason,
        },
        Problem::Crs(GeoError::UnknownCrs { crs, reason }) => GeoError::UnsupportedCrs {
            path: path.to_path_buf(),
            crs,
            reason,
        },
        Problem::Crs(other) => other,
    })
}

enum Problem {
    Missing,
    Unsupported(String),
    Crs(GeoError),
}

impl From<GeoError> for Problem {
    fn from(error: GeoError) -> Self {
        Self::Crs(error)
    }
}

fn code(keys: &GeoKeyDirectory, key: u16) -> Option<u16> {
    keys.get_short(key).filter(|&c| c != 0 && c != USER_DEFINED)
}

fn citation(keys: &GeoKeyDirectory) -> String {
    [ids::PROJ_CITATION, ids::GT_CITATION, ids::GEODETIC_CITATION]
        .iter()
        .find_map(|&key| keys.get_ascii(key))
        .map_or_else(
            || "user-defined".to_string(),
            |text| text.trim_end_matches('|').to_string(),
        )
}

/// Whether the citations alone say that a projected system is Web Mercator: its keys are those of a Mercator projection of the
/// ellipsoid, which is another.
fn is_named_web_mercator(keys: &GeoKeyDirectory) -> bool {
    let is_named = [ids::PROJ_CITATION, ids::GT_CITATION]
        .iter()
        .filter_map(|&key| keys.get_ascii(key))
        .any(|text| WEB_MERCATOR_NAMES.iter().any(|name| text.contains(name)));
    // Its variants with another origin or unit have names of their own.
    let is_plain = [
        KEY_NATURAL_ORIGIN_LON,
        KEY_NATURAL_ORIGIN_LAT,
        KEY_FALSE_EASTING,
        KEY_FALSE_NORTHING,
    ]
    .iter()
    .all(|&key| number(keys, key).unwrap_or(0.0) == 0.0)
        && matches!(metres_per_linear_unit(keys), Ok(None | Some(1.0)));
    is_named && is_plain && code(keys, ids::PROJECTED_CRS_TYPE).is_none()
}

fn geographic(keys: &GeoKeyDirectory) -> Result<FileCrs, Problem> {
    let unit_deg = degrees_per_angular_unit(keys).map_err(Problem::Unsupported)?;
    if let Some(code) = code(keys, ids::GEODETIC_CRS_TYPE) {
        let code = u32::from(code);
        let own_deg = degrees_per_unit_of_epsg(code);
        if unit_deg.is_some_and(|unit_deg| !is_same_unit(unit_deg, own_deg)) {
            return Err(Problem::Unsupported(format!(
                "EPSG:{code} has coordinates of {own_deg} degrees per unit, and GeogAngularUnitsGeoKey says {} degrees",
                unit_deg.unwrap_or_default()
            )));
        }
        return Ok(Crs::from_epsg(code)?.into());
    }
    let crs = Crs::from_proj_string(&format!("+proj=longlat {} +no_defs", datum(keys, None)?))?;
    Ok(FileCrs {
        crs,
        crs_units_per_file_unit: unit_deg.unwrap_or(1.0),
    })
}

fn projected(keys: &GeoKeyDirectory) -> Result<FileCrs, Problem> {
    let unit_m = metres_per_linear_unit(keys).map_err(Problem::Unsupported)?;
    if let Some(code) = code(keys, ids::PROJECTED_CRS_TYPE) {
        let crs = Crs::from_epsg(u32::from(code))?;
        let own_m = crs.metres_per_unit();
        if !crs.is_geographic() && unit_m.is_some_and(|unit_m| !is_same_unit(unit_m, own_m)) {
            return Err(Problem::Unsupported(format!(
                "EPSG:{code} has coordinates of {own_m} m per unit, and ProjLinearUnitsGeoKey says {} m",
                unit_m.unwrap_or_default()
            )));
        }
        return Ok(crs.into());
    }
    let datum = datum(keys, Some(central_meridian_deg(keys)?))?;
    let units = proj_units(unit_m.unwrap_or(1.0));
    let projection = match code(keys, ids::PROJECTION) {
        // EPSG's UTM conversions: 16001 to 16060 north, 16101 to 16160 south.
        Some(c @ 16001..=16060) => format!("+proj=utm +zone={}", c - 16000),
        Some(c @ 16101..=16160) => format!("+proj=utm +zone={} +south", c - 16100),
        Some(other) => {
            return Err(Problem::Unsupported(format!("projection code {other}")));
        }
        None => projection(keys)?,
    };
    Ok(Crs::from_proj_string(&format!("{projection} {datum} {units} +no_defs"))?.into())
}

/// An angle parameter, degrees: it is stored in the unit of GeogAngularUnitsGeoKey.
fn angle_deg(keys: &GeoKeyDirectory, key: u16) -> Result<Option<f64>, Problem> {
    let Some(value) = number(keys, key) else {
        return Ok(None);
    };
    let unit_deg = degrees_per_angular_unit(keys)
        .map_err(Problem::Unsupported)?
        .unwrap_or(1.0);
    Ok(Some(if unit_deg == 1.0 {
        value
    } else {
        value * unit_deg
    }))
}

fn first_angle_deg(keys: &GeoKeyDirectory, choices: &[u16]) -> Result<f64, Problem> {
    for &key in choices {
        if let Some(angle) = angle_deg(keys, key)? {
            return Ok(angle);
        }
    }
    Ok(0.0)
}

fn central_meridian_deg(keys: &GeoKeyDirectory) -> Result<f64, Problem> {
    first_angle_deg(
        keys,
        &[
            KEY_NATURAL_ORIGIN_LON,
            KEY_FALSE_ORIGIN_LON,
            KEY_CENTER_LON,
            KEY_STRAIGHT_VERTICAL_POLE_LON,
        ],
    )
}

fn number(keys: &GeoKeyDirectory, key: u16) -> Option<f64> {
    match &keys.get(key)?.value {
        GeoKeyValue::Double(values) => values.first().copied(),
        GeoKeyValue::Short(value) => Some(f64::from(*value)),
        GeoKeyValue::Ascii(_) => None,
    }
}

/// Ellipsoid, prime meridian and shift to WGS 84, under a projection with this central meridian.
fn datum(keys: &GeoKeyDirectory, lon_0_deg: Option<f64>) -> Result<String, Problem> {
    // A known geographic CRS under an own projection: its ellipsoid and shift.
    if let Some(code) = code(keys, ids::GEODETIC_CRS_TYPE) {
        let code = epsg_under_projection(u32::from(code), lon_0_deg);
        return Ok(Crs::from_epsg(code)?.datum());
    }
    let shift = keys.get_double(KEY_TO_WGS84);
    let mut text = match code(keys, ids::GEODETIC_DATUM) {
        Some(6326) => "+datum=WGS84".to_string(),
        Some(6269) => "+datum=NAD83".to_string(),
        Some(6258) => "+ellps=GRS80 +towgs84=0,0,0,0,0,0,0".to_string(),
        Some(code) if shift.is_none() => {
            let known = known_datum(&code.to_string(), axes_m(keys), lon_0_deg);
            known.map_or_else(|| ellipsoid(keys), Ok)?
        }
        _ => ellipsoid(keys)?,
    };
    if let Some(shift) = shift {
        let numbers: Vec<String> = shift.iter().map(f64::to_string).collect();
        text.push_str(&format!(" +towgs84={}", numbers.join(",")));
    }
    match (
        code(keys, KEY_PRIME_MERIDIAN),
        angle_deg(keys, KEY_PRIME_MERIDIAN_LONGITUDE)?,
    ) {
        (Some(8901) | None, None) => {}
        (_, Some(lon)) => text.push_str(&format!(" +pm={lon}")),
        (Some(other), None) => {
            return Err(Problem::Unsupported(format!("prime meridian {other}")));
        }
    }
    Ok(text)
}

/// Semi-major and semi-minor axis of the ellipsoid, metres, if it is described by them.
fn axes_m(keys: &GeoKeyDirectory) -> Option<(f64, f64)> {
    let a_m = number(keys, KEY_SEMI_MAJOR_AXIS)?;
    let b_m = match number(keys, KEY_INVERSE_FLATTENING) {
        Some(rf) if rf > 0.0 => a_m - a_m / rf,
        _ => number(keys, KEY_SEMI_MINOR_AXIS)?,
    };
    Some((a_m, b_m))
}

fn ellipsoid(keys: &GeoKeyDirectory) -> Result<String, Problem> {
    let a = number(keys, KEY_SEMI_MAJOR_AXIS);
    match (
        a,
        number(keys, KEY_INVERSE_FLATTENING),
        number(keys, KEY_SEMI_MINOR_AXIS),
    ) {
        (Some(a), Some(rf), _) if rf > 0.0 => return Ok(format!("+a={a} +rf={rf}")),
        (Some(a), _, Some(b)) => return Ok(format!("+a={a} +b={b}")),
        _ => {}
    }
    // EPSG ellipsoids.
    match code(keys, KEY_ELLIPSOID) {
        Some(7030) => Ok("+ellps=WGS84".to_string()),
        Some(7019) => Ok("+ellps=GRS80".to_string()),
        Some(7004) => Ok("+ellps=bessel".to_string()),
        Some(7022) => Ok("+ellps=intl".to_string()),
        Some(7001) => Ok("+ellps=airy".to_string()),
        Some(7008) => Ok("+ellps=clrk66".to_string()),
        Some(7024) => Ok("+ellps=krass".to_string()),
        Some(other) => Err(Problem::Unsupported(format!("ellipsoid {other}"))),
        None => Err(Problem::Missing),
    }
}

/// The projection of ProjMethodGeoKey (OGC GeoTIFF 1.1, table of projection methods) as a PROJ
/// string without datum.
fn projection(keys: &GeoKeyDirectory) -> Result<String, Problem> {
    let method = keys
        .get_short(ids::PROJ_COORD_TRANS)
        .ok_or(Problem::Missing)?;
    // Angles are in the unit of GeogAngularUnits; offsets in that of ProjLinearUnits.
    let any = |choices: &[u16]| choices.iter().find_map(|&key| number(keys, key));
    let lat_0 = first_angle_deg(
        keys,
        &[KEY_NATURAL_ORIGIN_LAT, KEY_FALSE_ORIGIN_LAT, KEY_CENTER_LAT],
    )?;
    let lon_0 = central_meridian_deg(keys)?;
    let unit_m = metres_per_linear_unit(keys)
        .map_err(Problem::Unsupported)?
        .unwrap_or(1.0);
    let x_0 = any(&[
        KEY_FALSE_EASTING,
        KEY_FALSE_ORIGIN_EASTING,
        KEY_CENTER_EASTING,
    ])
    .unwrap_or(0.0)
        * unit_m;
    let y_0 = any(&[
        KEY_FALSE_NORTHING,
        KEY_FALSE_ORIGIN_NORTHING,
        KEY_CENTER_NORTHING,
    ])
    .unwrap_or(0.0)
        * unit_m;
    let parameters = ProjectionParameters {
        lat_0_deg: lat_0,
        lon_0_deg: lon_0,
        lat_1_deg: angle_deg(keys, KEY_STD_PARALLEL_1)?,
        lat_2_deg: angle_deg(keys, KEY_STD_PARALLEL_2)?,
        azimuth_deg: None,
        rectified_angle_deg: None,
        scale: any(&[KEY_SCALE_AT_NATURAL_ORIGIN, KEY_SCALE_AT_CENTER]).unwrap_or(1.0),
        false_easting_m: x_0,
        false_northing_m: y_0,
    };
    let method = match method {
        1 => ProjectionMethod::TransverseMercator,
        7 => ProjectionMethod::Mercator,
        8 => ProjectionMethod::LambertConformal2,
        9 => ProjectionMethod::LambertConformal1,
        10 => ProjectionMethod::LambertAzimuthal,
        11 => ProjectionMethod::Albers,
        15 => ProjectionMethod::PolarStereographic,
        16 => ProjectionMethod::ObliqueStereographic,
        other => return Err(Problem::Unsupported(format!("projection method {other}"))),
    };
    method
        .proj_string(&parameters)
        .map_err(Problem::Unsupported)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LonLat, distance_m};

    /// The keys that GDAL writes for texts of ESRI without a code, and a place of `tests/definitions/wkt_golden.tsv` with its false
    /// easting moved by a kilometre.
    #[test]
    fn a_datum_code_has_its_shift() {
        let mut keys = GeoKeyDirectory::new();
        let short = [
            (ids::GT_MODEL_TYPE, MODEL_PROJECTED),
            (ids::GEODETIC_CRS_TYPE, USER_DEFINED),
            (ids::GEODETIC_DATUM, 6277),
            (ids::PROJECTED_CRS_TYPE, USER_DEFINED),
            (ids::PROJECTION, USER_DEFINED),
            (ids::PROJ_COORD_TRANS, 1),
        ];
        let double = [
            (KEY_SEMI_MAJOR_AXIS, 6_377_563.396),
            (KEY_INVERSE_FLATTENING, 299.324_964_6),
            (KEY_PRIME_MERIDIAN_LONGITUDE, 0.0),
            (KEY_NATURAL_ORIGIN_LON, -2.0),
            (KEY_NATURAL_ORIGIN_LAT, 49.0),
            (KEY_FALSE_EASTING, 401_000.0),
            (KEY_FALSE_NORTHING, -100_000.0),
            (KEY_SCALE_AT_NATURAL_ORIGIN, 0.999_601_271_7),
        ];
        for (key, value) in short {
            keys.set(key, GeoKeyValue::Short(value));
        }
        for (key, value) in double {
            keys.set(key, GeoKeyValue::Double(vec![value]));
        }
        let crs = crs_from_geokeys(&keys, Path::new("x.tif")).unwrap().crs;
        let found = crs.lonlat_from_xy(306_055.406, 610_582.448).unwrap();
        let off_m = distance_m(found, LonLat::new(-3.499_999_98, 55.38));
        assert!(off_m < 0.1, "{crs}: {off_m} m");
        assert_eq!(crs.caveat(), None);
        // Another ellipsoid under that code: the file's, and a warning.
        keys.set(
            KEY_SEMI_MAJOR_AXIS,
            GeoKeyValue::Double(vec![6_377_340.189]),
        );
        let crs = crs_from_geokeys(&keys, Path::new("x.tif")).unwrap().crs;
        assert!(crs.caveat().unwrap().contains("no shift"), "{crs}");
    }
}
