//! Maps of `../shared/data`, which is not part of the repository: run with `cargo test -- --ignored`.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use grimnet_geo::{LonLat, MapOptions, MapPx, WindowPx, distance_m, open_map};

fn shared_data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data")
}

#[test]
#[ignore = "needs ../shared/data"]
fn truth_of_fongyuan_agrees_with_its_map() {
    let data = shared_data();
    let map = open_map(&data.join("fongyuan/map.tif"), &MapOptions::default()).unwrap();
    assert_eq!(map.size_px(), (4103, 3894));
    assert_eq!(map.georeference().crs().definition(), "EPSG:4326");
    let mut table = csv::Reader::from_path(data.join("fongyuan/truth.csv")).unwrap();
    let headers = table.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|h| h == name).unwrap();
    let mut frames = 0;
    for row in table.records() {
        let row = row.unwrap();
        let value = |name: &str| row[column(name)].parse::<f64>().unwrap();
        let px = MapPx::new(value("map_x_px"), value("map_y_px"));
        let truth = LonLat::new(value("centre_lon"), value("centre_lat"));
        let ours = map.georeference().lonlat_from_map_px(px).unwrap();
        // Pixels are given to 0.1, that is 0.016 m; places to 1e-8 degrees.
        assert!(
            distance_m(ours, truth) < 0.02,
            "{}: {}",
            &row[0],
            distance_m(ours, truth)
        );
        let back = map.georeference().map_px_from_lonlat(truth).unwrap();
        assert!((back.x - px.x).abs() < 0.1 && (back.y - px.y).abs() < 0.1);
        frames += 1;
    }
    assert_eq!(frames, 31);
    let (x_m, y_m) = map
        .georeference()
        .ground_resolution_m(MapPx::new(2000.0, 2000.0))
        .unwrap();
    assert!(
        (x_m - 0.162).abs() < 0.001 && (y_m - 0.161).abs() < 0.001,
        "{x_m} {y_m}"
    );
}

#[test]
#[ignore = "needs ../shared/data"]
fn finland_is_one_mosaic() {
    let data = shared_data();
    let map = open_map(&data.join("maps/finland/map.csv"), &MapOptions::default()).unwrap();
    let (w, h) = map.size_px();
    // Three columns and five rows of pictures of 1406 to 1486 by 1230 to 1291 px that cover the
    // same ground each: the mosaic has the median resolution.
    assert!(
        (4300..4400).contains(&w) && (6250..6350).contains(&h),
        "{w} x {h}"
    );
    let centre = map.georeference().centre_px();
    let (x_m, y_m) = map.georeference().ground_resolution_m(centre).unwrap();
    assert!(
        (x_m - 0.1375).abs() < 0.002 && (y_m - x_m).abs() < 0.001,
        "{x_m} {y_m}"
    );
    let patch = map
        .read(WindowPx::new(0.0, 0.0, w as f64, h as f64), 440, 635)
        .unwrap();
    let seen = patch.valid.pixels().filter(|p| p.0[0] != 0).count() as f64 / (440.0 * 635.0);
    // Twelve pictures in a grid of fifteen places.
    assert!((seen - 0.8).abs() < 0.01, "{seen}");
}
