//! Coordinate systems that well-known text describes by parameters, without an EPSG code (WKT 1 of GDAL and of ESRI).

use crate::datum_names::known_datum;
use crate::projection::{ProjectionMethod, ProjectionParameters};
use crate::units::proj_units;
use crate::wkt::WktNode;
use crate::{Crs, GeoError};

/// Web Mercator, as ESRI names its projection.
const WEB_MERCATOR: (&str, u32) = ("mercator_auxiliary_sphere", 3857);
/// ESRI's stereographic projections from a pole, and the one whose origin says from where.
const NORTH_POLE: &str = "stereographic_north_pole";
const SOUTH_POLE: &str = "stereographic_south_pole";
const STEREOGRAPHIC: &str = "stereographic";
/// Radians of a degree, as the texts round them.
const RADIANS_PER_DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Projection methods, by their names of GDAL and of ESRI in small letters.
const METHODS: [(&str, ProjectionMethod); 23] = [
    ("transverse_mercator", ProjectionMethod::TransverseMercator),
    ("gauss_kruger", ProjectionMethod::TransverseMercator),
    ("mercator_1sp", ProjectionMethod::Mercator),
    ("mercator_2sp", ProjectionMethod::Mercator),
    ("mercator", ProjectionMethod::Mercator),
    (
        "lambert_conformal_conic_2sp",
        ProjectionMethod::LambertConformal2,
    ),
    (
        "lambert_conformal_conic_1sp",
        ProjectionMethod::LambertConformal1,
    ),
    // ESRI's has one standard parallel or two.
    (
        "lambert_conformal_conic",
        ProjectionMethod::LambertConformal2,
    ),
    (
        "lambert_azimuthal_equal_area",
        ProjectionMethod::LambertAzimuthal,
    ),
    ("albers_conic_equal_area", ProjectionMethod::Albers),
    ("albers", ProjectionMethod::Albers),
    ("polar_stereographic", ProjectionMethod::PolarStereographic),
    (NORTH_POLE, ProjectionMethod::PolarStereographic),
    (SOUTH_POLE, ProjectionMethod::PolarStereographic),
    // From a pole or, which is refused, from any other point.
    (STEREOGRAPHIC, ProjectionMethod::PolarStereographic),
    (
        "oblique_stereographic",
        ProjectionMethod::ObliqueStereographic,
    ),
    (
        "double_stereographic",
        ProjectionMethod::ObliqueStereographic,
    ),
    (
        "hotine_oblique_mercator_azimuth_center",
        ProjectionMethod::ObliqueMercatorCentre,
    ),
    (
        "rectified_skew_orthomorphic_center",
        ProjectionMethod::ObliqueMercatorCentre,
    ),
    (
        "hotine_oblique_mercator",
        ProjectionMethod::ObliqueMercatorOrigin,
    ),
    (
        "hotine_oblique_mercator_azimuth_natural_origin",
        ProjectionMethod::ObliqueMercatorOrigin,
    ),
    (
        "rectified_skew_orthomorphic_natural_origin",
        ProjectionMethod::ObliqueMercatorOrigin,
    ),
    ("krovak", ProjectionMethod::Krovak),
];

/// Azimuth and pseudo standard parallel of Krovak's projection, degrees: `proj4rs` has no others.
const KROVAK_AZIMUTH_DEG: f64 = 30.288_139_75;
const KROVAK_PARALLEL_DEG: f64 = 78.5;
/// Degrees by which texts round the azimuth.
const KROVAK_ROUNDING_DEG: f64 = 1e-5;

/// The coordinate system that a node describes.
///
/// # Errors
/// Returns what of it is not read.
pub(crate) fn crs_of_definition(system: &WktNode) -> Result<Crs, String> {
    if let Some(proj_string) = proj4_extension(system) {
        return Crs::from_proj_string(proj_string).map_err(reason);
    }
    let definition = match system.keyword.as_str() {
        "GEOGCS" => format!("+proj=longlat {} +no_defs", datum(system, None)?),
        "PROJCS" => {
            let name = method_name(system)?;
            if name == WEB_MERCATOR.0 && is_plain(&parameters(system, ProjectionMethod::Mercator)?)
            {
                return Crs::from_epsg(WEB_MERCATOR.1).map_err(reason);
            }
            let (_, method) = METHODS
                .iter()
                .find(|(known, _)| *known == name)
                .ok_or_else(|| format!("the projection {name} without an EPSG code"))?;
            let parameters = with_polar_origin(&name, parameters(system, *method)?)?;
            projected(system, *method, parameters)?
        }
        other => return Err(format!("{other} without an EPSG code")),
    };
    Crs::from_proj_string(&definition).map_err(reason)
}

fn reason(error: GeoError) -> String {
    match error {
        GeoError::UnknownCrs { reason, .. } => reason,
        other => other.to_string(),
    }
}

/// `EXTENSION["PROJ4","+proj=..."]`, which GDAL prefers to the rest.
fn proj4_extension(system: &WktNode) -> Option<&str> {
    let mut extensions = system.nodes().filter(|node| node.keyword == "EXTENSION");
    extensions
        .find(|node| node.text(0) == Some("PROJ4"))?
        .text(1)
}

fn projected(
    system: &WktNode,
    method: ProjectionMethod,
    parameters: ProjectionParameters,
) -> Result<String, String> {
    let base = system.node("GEOGCS").ok_or("no GEOGCS in its PROJCS")?;
    let method = match method {
        ProjectionMethod::LambertConformal2 if parameters.lat_2_deg.is_none() => {
            if parameters.lat_1_deg != Some(parameters.lat_0_deg) {
                return Err("a conic projection without its parallels".to_string());
            }
            ProjectionMethod::LambertConformal1
        }
        other => other,
    };
    let is_turned =
        |node: &WktNode| node.keyword == "AXIS" && matches!(node.text(1), Some("SOUTH" | "WEST"));
    if method != ProjectionMethod::PolarStereographic && system.nodes().any(is_turned) {
        return Err("axes to the south or west".to_string());
    }
    if method == ProjectionMethod::Krovak {
        check_krovak(system, &parameters)?;
    }
    check_scale(method, &parameters)?;
    let projection = method.proj_string(&parameters)?;
    let datum = datum(base, Some(parameters.lon_0_deg))?;
    let units = proj_units(linear_unit_m(system)?);
    Ok(format!("{projection} {datum} {units} +no_defs"))
}

/// Refuses a scale, or an origin of Mercator, that the PROJ string of the method leaves out.
fn check_scale(method: ProjectionMethod, parameters: &ProjectionParameters) -> Result<(), String> {
    let has_scale = match method {
        ProjectionMethod::LambertConformal2
        | ProjectionMethod::LambertAzimuthal
        | ProjectionMethod::Albers => false,
        ProjectionMethod::Mercator => parameters.lat_1_deg.is_none(),
        ProjectionMethod::PolarStereographic => parameters.lat_0_deg.abs() == 90.0,
        ProjectionMethod::TransverseMercator
        | ProjectionMethod::LambertConformal1
        | ProjectionMethod::ObliqueStereographic
        | ProjectionMethod::ObliqueMercatorCentre
        | ProjectionMethod::ObliqueMercatorOrigin
        | ProjectionMethod::Krovak => true,
    };
    if !has_scale && parameters.scale != 1.0 {
        return Err("a scale beside its standard parallels".to_string());
    }
    if method == ProjectionMethod::Mercator && parameters.lat_0_deg != 0.0 {
        return Err("a Mercator projection with its origin off the equator".to_string());
    }
    Ok(())
}

/// Refuses what a PROJ string cannot say of Krovak's projection, and axes that may point to the south and west, as they do by default:
/// ESRI turns them to the east and north by parameters, which [`parameters`] checks, GDAL states them.
fn check_krovak(system: &WktNode, parameters: &ProjectionParameters) -> Result<(), String> {
    let azimuth_deg = parameters.azimuth_deg.unwrap_or(KROVAK_AZIMUTH_DEG);
    if (azimuth_deg - KROVAK_AZIMUTH_DEG).abs() > KROVAK_ROUNDING_DEG {
        return Err(format!(
            "a Krovak projection with the azimuth {azimuth_deg}"
        ));
    }
    let axis = system.node("AXIS").and_then(|axis| axis.text(1));
    if parameters.rectified_angle_deg != Some(90.0) && axis != Some("EAST") {
        return Err("a Krovak projection that does not say where its axes point".to_string());
    }
    Ok(())
}

/// The projection method in small letters.
fn method_name(system: &WktNode) -> Result<String, String> {
    let name = system.node("PROJECTION").and_then(|node| node.text(0));
    let name = name.ok_or("no PROJECTION in its PROJCS")?;
    Ok(name.to_ascii_lowercase())
}

/// Parameters of a projection. Angles are in the unit of the ellipsoid's coordinates, which must be degrees; offsets in the unit of
/// the plane.
fn parameters(system: &WktNode, method: ProjectionMethod) -> Result<ProjectionParameters, String> {
    let unit_m = linear_unit_m(system)?;
    let is_krovak = method == ProjectionMethod::Krovak;
    let is_oblique = is_krovak
        || method == ProjectionMethod::ObliqueMercatorCentre
        || method == ProjectionMethod::ObliqueMercatorOrigin;
    let mut found = ProjectionParameters {
        lat_0_deg: 0.0,
        lon_0_deg: 0.0,
        lat_1_deg: None,
        lat_2_deg: None,
        azimuth_deg: None,
        rectified_angle_deg: None,
        scale: 1.0,
        false_easting_m: 0.0,
        false_northing_m: 0.0,
    };
    for parameter in system.nodes().filter(|node| node.keyword == "PARAMETER") {
        let name = parameter.text(0).unwrap_or_default().to_ascii_lowercase();
        let value = parameter
            .number(1)
            .ok_or_else(|| format!("the parameter {name} is no number"))?;
        match name.as_str() {
            "latitude_of_origin" | "latitude_of_center" => found.lat_0_deg = value,
            "central_meridian" | "longitude_of_center" => found.lon_0_deg = value,
            "standard_parallel_1" => found.lat_1_deg = Some(value),
            "standard_parallel_2" => found.lat_2_deg = Some(value),
            "scale_factor" => found.scale = value,
            "false_easting" => found.false_easting_m = value * unit_m,
            "false_northing" => found.false_northing_m = value * unit_m,
            "azimuth" if is_oblique => found.azimuth_deg = Some(value),
            "rectified_grid_angle" | "xy_plane_rotation" if is_oblique => {
                found.rectified_angle_deg = Some(value);
            }
            "pseudo_standard_parallel_1" if is_krovak && value == KROVAK_PARALLEL_DEG => {}
            "x_scale" if is_krovak && value == -1.0 => {}
            "y_scale" if is_krovak && value == 1.0 => {}
            "auxiliary_sphere_type" if value == 0.0 => {}
            _ => return Err(format!("the parameter {name}")),
        }
    }
    Ok(found)
}

/// Parameters with the latitude of origin that [`ProjectionMethod::PolarStereographic`] takes: ESRI states the latitude of true scale as
/// a standard parallel, and the pole by the name of the method.
fn with_polar_origin(
    name: &str,
    mut parameters: ProjectionParameters,
) -> Result<ProjectionParameters, String> {
    let sign: f64 = match name {
        NORTH_POLE => 1.0,
        SOUTH_POLE => -1.0,
        STEREOGRAPHIC if parameters.lat_0_deg.abs() != 90.0 => {
            return Err("a stereographic projection from another point than a pole".to_string());
        }
        _ => return Ok(parameters),
    };
    let parallel_deg = parameters.lat_1_deg.filter(|lat_1| lat_1 * sign > 0.0);
    parameters.lat_0_deg =
        parallel_deg.ok_or_else(|| format!("{name} without a standard parallel on its side"))?;
    Ok(parameters)
}

/// Whether Web Mercator has its own origin.
fn is_plain(parameters: &ProjectionParameters) -> bool {
    let ProjectionParameters {
        lat_0_deg,
        lon_0_deg,
        lat_1_deg,
        false_easting_m,
        false_northing_m,
        ..
    } = *parameters;
    let offsets = [lat_0_deg, lon_0_deg, false_easting_m, false_northing_m];
    offsets == [0.0; 4] && lat_1_deg.unwrap_or(0.0) == 0.0
}

fn linear_unit_m(system: &WktNode) -> Result<f64, String> {
    let Some(unit) = system.node("UNIT") else {
        return Ok(1.0);
    };
    unit.number(1)
        .filter(|metres| *metres > 0.0)
        .ok_or_else(|| "a UNIT without a size".to_string())
}

/// Ellipsoid, prime meridian and shift to WGS 84 of a GEOGCS, under a projection with this central meridian.
fn datum(geographic: &WktNode, lon_0_deg: Option<f64>) -> Result<String, String> {
    let unit = geographic.node("UNIT").and_then(|unit| unit.number(1));
    if !unit.is_none_or(|radians| (radians / RADIANS_PER_DEGREE - 1.0).abs() < 1e-9) {
        return Err("angles that are not in degrees".to_string());
    }
    let datum = geographic.node("DATUM").ok_or("no DATUM in its GEOGCS")?;
    if let Some(shift) = datum.node("TOWGS84") {
        let numbers: Vec<String> = (0..7)
            .map_while(|index| shift.number(index))
            .map(|number| number.to_string())
            .collect();
        return Ok(format!(
            "{} +towgs84={}{}",
            ellipsoid(datum)?,
            numbers.join(","),
            prime_meridian(geographic)
        ));
    }
    let name = datum.text(0).unwrap_or_default();
    let axes_m = spheroid(datum).map(axes_m);
    if let Some(known) = known_datum(name, axes_m, lon_0_deg) {
        return Ok(format!("{known}{}", prime_meridian(geographic)));
    }
    if let Some(code) = geographic.epsg() {
        return Ok(Crs::from_epsg(code).map_err(reason)?.datum());
    }
    Ok(format!(
        "{}{}",
        ellipsoid(datum)?,
        prime_meridian(geographic)
    ))
}

/// Semi-major axis in metres and inverse flattening, which is 0 for a sphere.
fn spheroid(datum: &WktNode) -> Option<(f64, f64)> {
    let node = datum.node("SPHEROID")?;
    Some((node.number(1)?, node.number(2)?))
}

/// Semi-major and semi-minor axis of an ellipsoid, metres.
fn axes_m((a_m, rf): (f64, f64)) -> (f64, f64) {
    let flattening = if rf == 0.0 { 0.0 } else { 1.0 / rf };
    (a_m, a_m - a_m * flattening)
}

fn ellipsoid(datum: &WktNode) -> Result<String, String> {
    match spheroid(datum) {
        Some((a, 0.0)) => Ok(format!("+a={a} +b={a}")),
        Some((a, rf)) => Ok(format!("+a={a} +rf={rf}")),
        None => Err("no SPHEROID in its DATUM".to_string()),
    }
}

/// The prime meridian as a further parameter, if it is not Greenwich.
fn prime_meridian(geographic: &WktNode) -> String {
    let meridian = geographic.node("PRIMEM").and_then(|node| node.number(1));
    match meridian {
        None | Some(0.0) => String::new(),
        Some(lon_deg) => format!(" +pm={lon_deg}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LonLat, distance_m};

    fn read(text: &str) -> Result<Crs, String> {
        crs_of_definition(WktNode::parse(text).unwrap().system().unwrap())
    }

    /// Texts that PROJ wrote for GDAL and for ESRI, a position in them, and its longitude and latitude by PROJ (pyproj).
    #[test]
    fn definitions_are_what_proj_takes_them_for() {
        for (text, (x, y), (lon_deg, lat_deg)) in [
            (
                r#"PROJCS["WGS_1984_UTM_Zone_52N",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",129.0],PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]"#,
                (500_123.0, 4_000_321.0),
                (129.001367284, 36.147612138),
            ),
            (
                r#"PROJCS["unknown",GEOGCS["unknown",DATUM["Unknown based on WGS 84 ellipsoid",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]]],PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",120],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH]]"#,
                (500_123.0, 4_000_321.0),
                (120.001367284, 36.147612138),
            ),
            (
                r#"PROJCS["NAD_1983_StatePlane_New_York_Long_Island_FIPS_3104_Feet",GEOGCS["GCS_North_American_1983",DATUM["D_North_American_1983",SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic"],PARAMETER["False_Easting",984250.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",-74.0],PARAMETER["Standard_Parallel_1",41.0333333333333],PARAMETER["Standard_Parallel_2",40.6666666666667],PARAMETER["Latitude_Of_Origin",40.1666666666667],UNIT["US survey foot",0.304800609601219]]"#,
                (987_654.0, 201_234.0),
                (-73.987720134, 40.719016877),
            ),
            (
                r#"PROJCS["WGS_1984_Web_Mercator_Auxiliary_Sphere",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Mercator_Auxiliary_Sphere"],PARAMETER["False_Easting",0.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",0.0],PARAMETER["Standard_Parallel_1",0.0],PARAMETER["Auxiliary_Sphere_Type",0.0],UNIT["Meter",1.0]]"#,
                (1_500_000.0, 6_900_000.0),
                (13.474729262, 52.548961912),
            ),
            (
                r#"PROJCS["unknown",GEOGCS["unknown",DATUM["Unknown based on Bessel 1841 ellipsoid using towgs84=565.4171,50.3319,465.5524,1.9342,-1.6677,9.1019,4.0725",SPHEROID["Bessel 1841",6377397.155,299.1528128],TOWGS84[565.4171,50.3319,465.5524,1.9342,-1.6677,9.1019,4.0725]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]]],PROJECTION["Oblique_Stereographic"],PARAMETER["latitude_of_origin",52.156],PARAMETER["central_meridian",5.387],PARAMETER["scale_factor",0.9999079],PARAMETER["false_easting",155000],PARAMETER["false_northing",463000],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH]]"#,
                (120_000.0, 487_000.0),
                (4.874929658, 52.370213581),
            ),
            (
                r#"PROJCS["unknown",GEOGCS["unknown",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]]],PROJECTION["Mercator_2SP"],PARAMETER["standard_parallel_1",30],PARAMETER["central_meridian",10],PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH]]"#,
                (100_000.0, 4_500_000.0),
                (11.036416781, 42.396909077),
            ),
            (
                r#"PROJCS["unknown",GEOGCS["unknown",DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257222101,AUTHORITY["EPSG","7019"]],AUTHORITY["EPSG","6269"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]]],PROJECTION["Albers_Conic_Equal_Area"],PARAMETER["latitude_of_center",23],PARAMETER["longitude_of_center",-96],PARAMETER["standard_parallel_1",29.5],PARAMETER["standard_parallel_2",45.5],PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH]]"#,
                (100_000.0, 1_500_000.0),
                (-94.872589251, 36.54167273),
            ),
            (
                r#"PROJCS["unknown",GEOGCS["unknown",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]]],PROJECTION["Polar_Stereographic"],PARAMETER["latitude_of_origin",-71],PARAMETER["central_meridian",0],PARAMETER["false_easting",0],PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]"#,
                (100_000.0, 1_500_000.0),
                (3.814074834, -76.227881287),
            ),
            // EPSG:3413, 3031 and 32761.
            (
                r#"PROJCS["WGS_1984_NSIDC_Sea_Ice_Polar_Stereographic_North",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Stereographic_North_Pole"],PARAMETER["False_Easting",0.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",-45.0],PARAMETER["Standard_Parallel_1",70.0],UNIT["Meter",1.0]]"#,
                (123_456.0, -1_900_000.0),
                (-41.282327296, 72.5541787),
            ),
            (
                r#"PROJCS["WGS_1984_Antarctic_Polar_Stereographic",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Stereographic_South_Pole"],PARAMETER["False_Easting",0.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",0.0],PARAMETER["Standard_Parallel_1",-71.0],UNIT["Meter",1.0]]"#,
                (300_000.0, -1_300_000.0),
                (167.005383208, -77.765607138),
            ),
            (
                r#"PROJCS["UPS_South",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Stereographic"],PARAMETER["False_Easting",2000000.0],PARAMETER["False_Northing",2000000.0],PARAMETER["Central_Meridian",0.0],PARAMETER["Scale_Factor",0.994],PARAMETER["Latitude_Of_Origin",-90.0],UNIT["Meter",1.0]]"#,
                (1_900_000.0, 2_300_000.0),
                (-18.434948823, -87.152274993),
            ),
            (
                r#"GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]"#,
                (120.5, 24.5),
                (120.5, 24.5),
            ),
        ] {
            let place = read(text).unwrap().lonlat_from_xy(x, y).unwrap();
            let apart_m = distance_m(place, LonLat::new(lon_deg, lat_deg));
            assert!(apart_m < 0.01, "{text}: {apart_m} m");
        }
    }

    /// Texts of ESRI and of GDAL without any code, against PROJ without grids (`make_wkt_golden.py`).
    #[test]
    fn a_datum_has_the_shift_of_its_code() {
        // PROJ's transformation of Indian 1975 turns the wrong way.
        const PROJ_IS_OFF: u32 = 4240;
        // The list has another shift for the code than for its datum: SAD69 on another ellipsoid, and Stereo 70.
        const OTHER_SHIFT: [u32; 2] = [4291, 3844];
        let mut wrong = Vec::new();
        let golden = include_str!("../tests/definitions/wkt_golden.tsv");
        for line in golden.lines().skip(1) {
            let columns: Vec<&str> = line.splitn(6, '\t').collect();
            let &[code, x, y, lon_deg, lat_deg, text] = columns.as_slice() else {
                panic!("{line}");
            };
            let [x, y, lon_deg, lat_deg] = [x, y, lon_deg, lat_deg].map(|n| n.parse().unwrap());
            let code = code.parse().unwrap();
            let coded = Crs::from_epsg(code).unwrap();
            let crs = match read(text) {
                Ok(crs) => crs,
                Err(reason) => {
                    wrong.push(format!("EPSG:{code}: {reason}"));
                    continue;
                }
            };
            let place = crs.lonlat_from_xy(x, y).unwrap();
            let from_coded_m = distance_m(place, coded.lonlat_from_xy(x, y).unwrap());
            let from_proj_m = distance_m(place, LonLat::new(lon_deg, lat_deg));
            let promised_m = if crs.caveat().is_none() { 5.0 } else { 100.0 };
            let is_near_proj = from_proj_m < promised_m || code == PROJ_IS_OFF;
            let is_as_coded = from_coded_m < 0.01 || OTHER_SHIFT.contains(&code);
            if crs.caveat() != coded.caveat() || !is_as_coded || !is_near_proj {
                wrong.push(format!(
                    "EPSG:{code}: {from_coded_m:.3} m from its code, {from_proj_m:.1} m from PROJ, {:?}: {text}",
                    crs.caveat()
                ));
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }

    #[test]
    fn a_datum_that_is_not_sure_has_no_shift() {
        let system = |datum: &str, axis_m: f64| {
            read(&format!(
                r#"GEOGCS["x",DATUM["{datum}",SPHEROID["y",{axis_m},299.1528128]],PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]]"#
            ))
        };
        assert_eq!(system("D_MGI", 6_377_397.155).unwrap().caveat(), None);
        for (datum, axis_m) in [
            ("D_MGI", 6_378_206.4),
            ("D_Nowhere_1900", 6_377_397.155),
            ("D_North_American_1927", 6_378_206.4),
        ] {
            let crs = system(datum, axis_m).unwrap();
            assert!(crs.caveat().unwrap().contains("no shift"), "{datum}");
        }
    }

    /// PROJ has no transformation of IG05, so that the golden texts lack it: a shift of 78 m.
    #[test]
    fn the_grid_of_israel_of_2005_has_the_shift_of_its_code() {
        let text = r#"PROJCS["Israeli_Grid_05",GEOGCS["IG05_Intermediate_CRS",DATUM["IG05_Intermediate_Datum",SPHEROID["GRS_1980",6378137.0,298.257222101]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["False_Easting",219529.584],PARAMETER["False_Northing",626907.39],PARAMETER["Central_Meridian",35.2045169444444],PARAMETER["Scale_Factor",1.0000067],PARAMETER["Latitude_Of_Origin",31.7343936111111],UNIT["Meter",1.0]]"#;
        let place = |crs: Crs| crs.lonlat_from_xy(180_000.0, 660_000.0).unwrap();
        let coded = place(Crs::from_epsg(6984).unwrap());
        let off_m = distance_m(place(read(text).unwrap()), coded);
        assert!(off_m < 0.01, "{off_m} m");
    }

    /// EPSG:31275 has the datum MGI and lies in Croatia, as EPSG:3907, MGI 1901; the place is PROJ's for EPSG:3907.
    #[test]
    fn yugoslav_zones_of_mgi_have_mgi_1901() {
        let text = r#"PROJCS["MGI_Balkans_5",GEOGCS["GCS_MGI",DATUM["D_MGI",SPHEROID["Bessel_1841",6377397.155,299.1528128]],PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],PARAMETER["False_Easting",5500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",15.0],PARAMETER["Scale_Factor",0.9999],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]"#;
        let place = LonLat::new(14.94, 44.914_999_94);
        for crs in [
            read(text).unwrap(),
            Crs::from_epsg(31275).unwrap(),
            Crs::from_epsg(3907).unwrap(),
        ] {
            let found = crs.lonlat_from_xy(5_495_635.378, 4_974_516.622).unwrap();
            let off_m = distance_m(found, place);
            assert!(off_m < 10.0, "{crs}: {off_m} m");
            assert!(crs.caveat().is_some(), "{crs}");
        }
    }

    #[test]
    fn what_is_not_read_is_said() {
        let whole = |projection: &str| {
            format!(
                r#"PROJCS["x",GEOGCS["y",DATUM["WGS_1984",SPHEROID["z",6378137,298.257223563]],UNIT["degree",0.0174532925199433]],{projection}]"#
            )
        };
        for (projection, words) in [
            (r#"PROJECTION["Bonne"]"#, "bonne"),
            (r#"PROJECTION["Hotine_Oblique_Mercator"]"#, "azimuth"),
            (
                r#"PROJECTION["Stereographic"],PARAMETER["latitude_of_origin",50]"#,
                "another point",
            ),
            (
                r#"PROJECTION["Stereographic_South_Pole"],PARAMETER["standard_parallel_1",71]"#,
                "on its side",
            ),
            (r#"PROJECTION["Krovak"]"#, "axes point"),
            (r#"PROJECTION["Krovak"],PARAMETER["X_Scale",1]"#, "x_scale"),
            (
                r#"PROJECTION["Krovak"],PARAMETER["azimuth",30.3],AXIS["X",EAST]"#,
                "30.3",
            ),
            (
                r#"PROJECTION["Mercator_1SP"],PARAMETER["azimuth",3]"#,
                "azimuth",
            ),
            (
                r#"PROJECTION["Albers"],PARAMETER["standard_parallel_1",3]"#,
                "parallels",
            ),
            (
                r#"PROJECTION["Transverse_Mercator"],AXIS["X",SOUTH]"#,
                "south",
            ),
            (
                r#"PROJECTION["Mercator_2SP"],PARAMETER["standard_parallel_1",3],PARAMETER["scale_factor",2]"#,
                "scale",
            ),
            (r#"PROJECTION["Mercator_1SP"],UNIT["x",-1]"#, "UNIT"),
        ] {
            let reason = read(&whole(projection)).unwrap_err();
            assert!(reason.contains(words), "{projection}: {reason}");
        }
        let grads =
            r#"GEOGCS["x",DATUM["y",SPHEROID["z",6378137,298]],UNIT["grad",0.015707963267949]]"#;
        assert!(read(grads).unwrap_err().contains("degrees"));
        assert!(read(r#"PROJCRS["x"]"#).unwrap_err().contains("EPSG"));
    }
}
