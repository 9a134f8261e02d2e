//! Units of angles and lengths in GeoTIFF keys.

use super::*;

/// GeoKeys of the given model type: `(key, code)` pairs, and `(key, number)` pairs stored as doubles.
fn geokeys(shorts: &[(u16, u16)], doubles: &[(u16, f64)]) -> Vec<support::Tag> {
    let mut entries: Vec<[u16; 4]> = shorts.iter().map(|&(k, v)| [k, 0, 1, v]).collect();
    entries.extend(
        doubles
            .iter()
            .enumerate()
            .map(|(i, &(k, _))| [k, 34736, 1, i as u16]),
    );
    entries.sort_unstable();
    let mut directory = vec![1, 1, 0, entries.len() as u16];
    directory.extend(entries.concat());
    let numbers: Vec<f64> = doubles.iter().map(|&(_, v)| v).collect();
    let mut tags = vec![short(34735, &directory)];
    if !numbers.is_empty() {
        tags.push(double(34736, &numbers));
    }
    tags
}

/// A map of 20 x 10 pixels with this pixel size and origin.
fn placed_map(path: &Path, pixel: f64, origin: [f64; 2], keys: Vec<support::Tag>) {
    let mut tags = keys;
    tags.push(double(33550, &[pixel, pixel, 0.0]));
    tags.push(double(33922, &[0.0, 0.0, 0.0, origin[0], origin[1], 0.0]));
    write_map(path, (20, 10), tags, colours);
}

/// Keys of a geographic CRS on the ellipsoid of WGS 84 in an angular unit (EPSG code), and its size in radians.
fn geographic_keys(unit: u16, size_rad: Option<f64>) -> Vec<support::Tag> {
    let mut numbers = vec![(2057, 6_378_137.0), (2059, 298.257_223_563)];
    numbers.extend(size_rad.map(|size| (2055, size)));
    geokeys(
        &[
            (1024, 2),
            (1025, 1),
            (2048, 32767),
            (2050, 6326),
            (2054, unit),
            (2056, 32767),
        ],
        &numbers,
    )
}

#[test]
fn angular_units_other_than_degrees_are_converted() {
    let dir = folder();
    let expected = LonLat::new(2.25, 48.6);
    let grad = std::f64::consts::PI / 200.0;
    let units = [
        (9102, None, 1.0),
        (9101, None, 180.0 / std::f64::consts::PI),
        (9105, None, 0.9),
        (9106, None, 0.9),
        (9103, None, 1.0 / 60.0),
        (9104, None, 1.0 / 3600.0),
        (32767, Some(grad), 0.9),
    ];
    for (unit, size_rad, degrees) in units {
        let path = dir.path().join(format!("unit{unit}.tif"));
        let origin = [expected.lon_deg / degrees, expected.lat_deg / degrees];
        placed_map(
            &path,
            1e-5 / degrees,
            origin,
            geographic_keys(unit, size_rad),
        );
        let map = open(&path).unwrap();
        let found = map
            .georeference()
            .lonlat_from_map_px(MapPx::new(0.0, 0.0))
            .unwrap();
        assert!(distance_m(found, expected) < 1e-3, "unit {unit}: {found:?}");
        let (x_m, y_m) = map
            .georeference()
            .ground_resolution_m(MapPx::new(10.0, 5.0))
            .unwrap();
        assert!(
            (x_m - 0.737).abs() < 0.01 && (y_m - 1.112).abs() < 0.01,
            "unit {unit}: {x_m} {y_m}"
        );
    }
    // Degrees, minutes and seconds in one number cannot be scaled; a unit needs its size.
    for (unit, words) in [(9107, "9107"), (32767, "without a positive size")] {
        let path = dir.path().join(format!("refused{unit}.tif"));
        placed_map(&path, 1e-5, [2.0, 48.0], geographic_keys(unit, None));
        refused(open(&path), &path, &[words]);
    }
}

#[test]
fn coordinate_systems_in_grads_are_not_read_as_degrees() {
    let dir = folder();
    let path = dir.path().join("grads.tif");
    let keys = |code: u16, unit: Option<u16>| {
        let mut shorts = vec![(1024, 2), (1025, 1), (2048, code)];
        shorts.extend(unit.map(|unit| (2054, unit)));
        geokeys(&shorts, &[])
    };
    // NTF (Paris), with and without its unit.
    for unit in [None, Some(9105)] {
        placed_map(&path, 1e-5, [2.5, 54.0], keys(4807, unit));
        refused(open(&path), &path, &["grads"]);
    }
    // WGS 84 that is said to be in grads.
    placed_map(&path, 1e-5, [2.5, 54.0], keys(4326, Some(9105)));
    refused(open(&path), &path, &["EPSG:4326", "GeogAngularUnitsGeoKey"]);
    assert!(grimnet_geo::Crs::parse("EPSG:4807").is_err());
}

#[test]
fn angles_of_a_projection_are_read_in_their_unit() {
    let dir = folder();
    // A transverse Mercator projection about 3 degrees east, its parameters in grads.
    let keys = |unit: u16, per_degree: f64| {
        geokeys(
            &[
                (1024, 1),
                (1025, 1),
                (2048, 4326),
                (2054, unit),
                (3072, 32767),
                (3074, 32767),
                (3075, 1),
                (3076, 9001),
            ],
            &[
                (3080, 3.0 * per_degree),
                (3081, 45.0 * per_degree),
                (3082, 500_000.0),
                (3083, 0.0),
                (3092, 1.0),
            ],
        )
    };
    for (unit, per_degree) in [(9102, 1.0), (9105, 1.0 / 0.9)] {
        let path = dir.path().join(format!("tmerc{unit}.tif"));
        placed_map(&path, 0.5, [500_000.0, 0.0], keys(unit, per_degree));
        let map = open(&path).unwrap();
        let found = map
            .georeference()
            .lonlat_from_map_px(MapPx::new(0.0, 0.0))
            .unwrap();
        assert!(
            distance_m(found, LonLat::new(3.0, 45.0)) < 1e-3,
            "unit {unit}: {found:?}"
        );
    }
}

#[test]
fn a_linear_unit_that_contradicts_the_code_is_refused() {
    let dir = folder();
    let path = dir.path().join("feet.tif");
    let keys = |unit: u16| geokeys(&[(1024, 1), (1025, 1), (3072, 32651), (3076, unit)], &[]);
    placed_map(&path, 0.5, [300_000.0, 2_700_000.0], keys(9001));
    open(&path).unwrap();
    // UTM is in metres: the same numbers in US survey feet are elsewhere.
    placed_map(&path, 0.5, [300_000.0, 2_700_000.0], keys(9003));
    refused(open(&path), &path, &["EPSG:32651", "ProjLinearUnitsGeoKey"]);
    placed_map(&path, 0.5, [300_000.0, 2_700_000.0], keys(9096));
    refused(open(&path), &path, &["EPSG:9096"]);
}
