//! Round trips and equations.

use approx::assert_relative_eq;
use grimnet_geo::{
    Affine, Crs, Georeference, LevelFrame, LevelPx, LonLat, MapPx, bearing_deg, destination,
    destination_en_m, distance_m, offset_en_m, turn_deg,
};
use proptest::prelude::*;

/// Places within the reach of a CRS: longitude and latitude, half a degree around its middle.
fn crs_and_place() -> impl Strategy<Value = (u32, LonLat)> {
    let middles = prop::sample::select(vec![
        (4326, 120.7, 24.2),
        (3857, -70.0, -33.0),
        (32651, 120.7, 24.2),
        (32733, 15.5, -22.5),
        (3826, 120.7, 24.2),
        (2193, 174.7, -41.3),
        (25832, 9.0, 48.0),
        (2154, 2.35, 48.85),
        (3035, 10.0, 52.0),
        (3832, 179.9, -17.0),
    ]);
    (middles, -0.5..0.5, -0.5..0.5).prop_map(|((epsg, lon, lat), dx, dy)| {
        (
            epsg,
            LonLat::new(grimnet_geo::wrap_longitude_deg(lon + dx), lat + dy),
        )
    })
}

proptest! {
    #[test]
    fn lonlat_comes_back((epsg, place) in crs_and_place()) {
        let crs = Crs::from_epsg(epsg).unwrap();
        let (x, y) = crs.xy_from_lonlat(place).unwrap();
        let back = crs.lonlat_from_xy(x, y).unwrap();
        prop_assert!(distance_m(place, back) < 1e-4, "EPSG:{epsg} {place:?} {back:?}");
    }

    #[test]
    fn map_pixels_come_back_through_any_rotation(
        (epsg, place) in crs_and_place(),
        angle in 0.0..std::f64::consts::TAU,
        scale_x in 0.05..5.0_f64,
        scale_y in 0.05..5.0_f64,
        col in -5_000.0..50_000.0_f64,
        row in -5_000.0..50_000.0_f64,
    ) {
        let crs = Crs::from_epsg(epsg).unwrap();
        let (x, y) = crs.xy_from_lonlat(place).unwrap();
        let unit = if crs.is_geographic() { 1e-5 } else { 1.0 };
        let (sin, cos) = angle.sin_cos();
        let affine = Affine::from_gdal([
            x,
            unit * scale_x * cos,
            unit * scale_y * sin,
            y,
            unit * scale_x * sin,
            -unit * scale_y * cos,
        ]).unwrap();
        let map = Georeference::new(affine, crs, (40_000, 40_000));
        let px = MapPx::new(col, row);
        let back = map.map_px_from_lonlat(map.lonlat_from_map_px(px).unwrap()).unwrap();
        prop_assert!((back.x - col).abs() < 1e-2 && (back.y - row).abs() < 1e-2, "{px:?} {back:?}");
    }

    #[test]
    fn the_jacobian_predicts_offsets(
        (epsg, place) in crs_and_place(),
        angle in 0.0..std::f64::consts::TAU,
        dx in -50.0..50.0_f64,
        dy in -50.0..50.0_f64,
    ) {
        let crs = Crs::from_epsg(epsg).unwrap();
        let (x, y) = crs.xy_from_lonlat(place).unwrap();
        let unit = if crs.is_geographic() { 2e-6 } else { 0.3 };
        let (sin, cos) = angle.sin_cos();
        let affine = Affine::from_gdal([x, unit * cos, unit * sin, y, unit * sin, -unit * cos]).unwrap();
        let map = Georeference::new(affine, crs, (1000, 1000));
        let at = MapPx::new(300.0, 200.0);
        let j = map.east_north_m_from_map_px_jacobian(at).unwrap();
        let en = j * nalgebra::Vector2::new(dx, dy);
        let there = map.lonlat_from_map_px(MapPx::new(at.x + dx, at.y + dy)).unwrap();
        let (east, north) = offset_en_m(map.lonlat_from_map_px(at).unwrap(), there);
        prop_assert!((en.x - east).abs() < 2e-3 && (en.y - north).abs() < 2e-3,
            "EPSG:{epsg}: {en:?}, {east} {north}");
        // Up is where the top of the map is.
        let up = map.up_bearing_deg(at).unwrap();
        let above = map.lonlat_from_map_px(MapPx::new(at.x, at.y - 100.0)).unwrap();
        let bearing = bearing_deg(map.lonlat_from_map_px(at).unwrap(), above);
        let off = turn_deg(bearing, up);
        prop_assert!(off.abs() < 0.01, "EPSG:{epsg}: {up}, {bearing}");
    }

    #[test]
    fn destinations_come_back(
        lon in -180.0..180.0_f64, lat in -80.0..80.0_f64,
        bearing in 0.0..360.0_f64, length in 0.1..20_000.0_f64,
    ) {
        let from = LonLat::new(lon, lat);
        let to = destination(from, bearing, length);
        prop_assert!((distance_m(from, to) - length).abs() < 1e-6);
        let (east, north) = offset_en_m(from, to);
        prop_assert!(distance_m(destination_en_m(from, east, north), to) < 1e-6);
    }
}

#[test]
fn a_level_is_square_on_the_ground() {
    // Degrees at 60 north: a pixel of equal degrees is half as wide as high.
    let affine = Affine::from_gdal([22.46, 2e-6, 0.0, 60.41, 0.0, -2e-6]).unwrap();
    let size = (5000, 3000);
    let map = Georeference::new(affine, Crs::wgs84().unwrap(), size);
    let level = LevelFrame::new(&map, size, 0.5).unwrap();
    let (w, h) = (level.width_px as f64, level.height_px as f64);
    let at = |x: f64, y: f64| {
        map.lonlat_from_map_px(level.map_px_from_level_px(LevelPx::new(x, y)))
            .unwrap()
    };
    let right = distance_m(at(w / 2.0, h / 2.0), at(w / 2.0 + 100.0, h / 2.0));
    let down = distance_m(at(w / 2.0, h / 2.0), at(w / 2.0, h / 2.0 + 100.0));
    assert_relative_eq!(right, 50.0, epsilon = 1e-3);
    assert_relative_eq!(down, 50.0, epsilon = 1e-3);
    let end = level.map_px_from_level_px(LevelPx::new(w, h));
    assert!(end.x >= 4999.9 && end.y >= 2999.9, "{end:?}");
    assert!(LevelFrame::new(&map, size, 0.0).is_err());
    assert!(LevelFrame::new(&map, size, f64::NAN).is_err());
}

#[test]
fn a_georeference_survives_json() {
    let affine = Affine::from_gdal([300000.0, 0.1, 0.02, 2700000.0, 0.03, -0.1]).unwrap();
    for crs in [
        "EPSG:32651",
        "+proj=tmerc +lat_0=23 +lon_0=120 +k=0.9999 +x_0=0 +y_0=0 +datum=WGS84 +units=m",
    ] {
        let map = Georeference::new(affine, Crs::parse(crs).unwrap(), (100, 200));
        let text = serde_json::to_string(&map).unwrap();
        let back: Georeference = serde_json::from_str(&text).unwrap();
        assert_eq!(map, back);
        let px = MapPx::new(12.0, 34.0);
        assert_eq!(
            map.lonlat_from_map_px(px).unwrap(),
            back.lonlat_from_map_px(px).unwrap()
        );
    }
    assert!(serde_json::from_str::<Crs>("\"EPSG:1\"").is_err());
}

#[test]
fn crs_are_read_in_the_ways_they_are_written() {
    let utm = Crs::from_epsg(32651).unwrap();
    for text in [
        "EPSG:32651",
        "epsg:32651",
        " 32651 ",
        "urn:ogc:def:crs:EPSG::32651",
    ] {
        assert_eq!(Crs::parse(text).unwrap(), utm, "{text}");
    }
    assert_eq!(Crs::parse("OGC:CRS84").unwrap(), Crs::wgs84().unwrap());
    let nad27 = Crs::from_epsg(4267).unwrap_err().to_string();
    assert!(
        nad27.contains("grid") && nad27.contains("gdalwarp"),
        "{nad27}"
    );
    assert!(
        Crs::from_epsg(2000)
            .unwrap()
            .caveat()
            .unwrap()
            .contains("no shift")
    );
    // One shift of three parameters for all of Europe.
    for coarse in [
        "EPSG:23032",
        "+proj=longlat +ellps=intl +towgs84=-87,-98,-121,0,0,0,0",
    ] {
        let caveat = Crs::parse(coarse).unwrap().caveat().unwrap().to_string();
        assert!(
            caveat.contains("three parameters") && caveat.contains("gdalwarp"),
            "{coarse}: {caveat}"
        );
    }
    // The ellipsoid by its numbers, as files give it.
    let by_numbers = "+proj=laea +lat_0=52 +lon_0=10 +a=6378137 +rf=298.257222101 +units=m";
    assert_eq!(Crs::parse(by_numbers).unwrap().caveat(), None);
    for exact in [
        4326, 3857, 32651, 3826, 28992, 27700, 2056, 7844, 5514, 3844, 2039, 5562,
    ] {
        assert_eq!(
            Crs::from_epsg(exact).unwrap().caveat(),
            None,
            "EPSG:{exact}"
        );
    }
}

/// Coordinates of longitudes and latitudes by pyproj 3.7.2 (PROJ 9.5.1) without grids.
#[test]
fn datum_shifts_are_those_of_the_registry() {
    for (code, x, y, lon_deg, lat_deg) in [
        (3844, 564_954.224_308_6, 484_257.944_090_8, 25.835, 45.855),
        (2039, 193_346.087_678_6, 585_940.482_429_6, 34.93, 31.365),
        (6384, 300_116.789_558_4, 5_292_966.506_607, 30.0, 47.77),
    ] {
        let found = Crs::from_epsg(code).unwrap().lonlat_from_xy(x, y).unwrap();
        let off_m = distance_m(found, LonLat::new(lon_deg, lat_deg));
        assert!(off_m < 0.01, "EPSG:{code}: {off_m} m");
    }
}

/// Metres on the ground of pixels of 0.5 m by pyproj 3.7.2, as lengths of geodesics through the point.
#[test]
fn a_pole_is_a_place_as_others_are() {
    for (code, x, y, pole, gsd_m) in [
        (3031, 0.0, 0.0, -90.0, 0.513_996_635_762),
        (3413, 0.0, 0.0, 90.0, 0.515_539_287_060),
        (5041, 2e6, 2e6, 90.0, 0.503_018_108_655),
    ] {
        // The pole in the middle, near the middle of a pixel, and 30 m from it.
        for (dx, dy) in [(0.0, 0.0), (3.0, 4.0), (21.0, -21.0)] {
            let (left, top) = (x + dx - 500.0, y + dy + 400.0);
            let affine = Affine::from_gdal([left, 0.5, 0.0, top, 0.0, -0.5]).unwrap();
            let map = Georeference::new(affine, Crs::from_epsg(code).unwrap(), (2000, 1600));
            let centre = map.centre_px();
            let (x_m, y_m) = map.ground_resolution_m(centre).unwrap();
            assert_relative_eq!(x_m, gsd_m, epsilon = 1e-8);
            assert_relative_eq!(y_m, gsd_m, epsilon = 1e-8);
            // Up is where the top of the map is.
            let at = map.lonlat_from_map_px(centre).unwrap();
            let above = map
                .lonlat_from_map_px(MapPx::new(centre.x, centre.y - 100.0))
                .unwrap();
            let up = map.up_bearing_deg(centre).unwrap();
            let off = turn_deg(bearing_deg(at, above), up);
            assert!(off.abs() < 0.01, "EPSG:{code} {dx} {dy}: {up}");
            let [west, south, east, north] = map.bounds_deg().unwrap();
            assert_eq!((west, east), (-180.0, 180.0));
            let (edge, at_pole) = if pole > 0.0 {
                (south, north)
            } else {
                (north, south)
            };
            assert_eq!(at_pole, pole);
            assert!((edge - pole).abs() > 0.005, "{edge}");
        }
    }
}

#[test]
fn bounds_are_on_one_side_of_the_antimeridian() {
    for (left, west) in [
        (179.96, 179.96),
        (-180.04, 179.96),
        (185.0, -175.0),
        (8.0, 8.0),
    ] {
        let affine = Affine::from_gdal([left, 1e-3, 0.0, -16.5, 0.0, -1e-3]).unwrap();
        let map = Georeference::new(affine, Crs::wgs84().unwrap(), (80, 30));
        let expected = [west, -16.53, west + 0.08, -16.5];
        for (ours, theirs) in map.bounds_deg().unwrap().into_iter().zip(expected) {
            assert_relative_eq!(ours, theirs, epsilon = 1e-9);
        }
    }
}

#[test]
fn places_outside_a_projection_are_an_error() {
    let utm = Crs::from_epsg(32651).unwrap();
    assert!(utm.xy_from_lonlat(LonLat::new(0.0, 91.0)).is_err());
    assert!(utm.xy_from_lonlat(LonLat::new(f64::NAN, 0.0)).is_err());
    assert!(utm.lonlat_from_xy(f64::INFINITY, 0.0).is_err());
    assert!(Crs::wgs84().unwrap().lonlat_from_xy(0.0, 90.1).is_err());
    assert!(
        Crs::from_epsg(3857)
            .unwrap()
            .xy_from_lonlat(LonLat::new(0.0, 90.0))
            .is_err()
    );
}

#[test]
fn an_affine_without_inverse_cannot_be_made() {
    let refused = [
        [0.0; 6],
        [0.0, 1.0, 2.0, 0.0, 1.0, 2.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, f64::NAN],
        [f64::INFINITY, 1.0, 0.0, 0.0, 0.0, -1.0],
        [0.0, 1e-200, 0.0, 0.0, 0.0, -1e-200],
    ];
    for coefficients in refused {
        let error = Affine::from_gdal(coefficients).unwrap_err().to_string();
        assert!(error.contains("no inverse"), "{error}");
    }
    // Nor read from a file.
    let good = Affine::from_gdal([1.0, 2.0, 0.0, 3.0, 0.0, -4.0]).unwrap();
    let text = serde_json::to_string(&good).unwrap();
    assert_eq!(serde_json::from_str::<Affine>(&text).unwrap(), good);
    let singular = text.replace("\"x_from_col\":2.0", "\"x_from_col\":0.0");
    assert_ne!(singular, text);
    assert!(serde_json::from_str::<Affine>(&singular).is_err());
}
