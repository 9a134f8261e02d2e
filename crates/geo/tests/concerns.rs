//! What looks wrong with a map: a map for each warning, and one without any.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use std::path::{Path, PathBuf};

use grimnet_geo::{Concern, MapOptions, concerns, open_map, overview};
use support::{Tag, double, geo_tags, short, write_map};

/// Names of what looks wrong with a map, and its texts.
fn found(path: &Path, crs: Option<&str>) -> (Vec<&'static str>, String) {
    let options = MapOptions {
        crs: crs.map(str::to_owned),
        ..MapOptions::default()
    };
    let map = open_map(path, &options).unwrap();
    let picture = overview(map.as_ref()).unwrap();
    let concerns = concerns(map.as_ref(), &picture).unwrap();
    let texts: Vec<String> = concerns.iter().map(Concern::to_string).collect();
    (
        concerns.iter().map(Concern::name).collect(),
        texts.join("\n"),
    )
}

fn colours(x: u32, y: u32) -> [u8; 3] {
    [(x * 7) as u8, (y * 5) as u8, (x * y) as u8]
}

/// A map of 80 x 60 pixels.
fn map(geo: Vec<Tag>, pixel: impl Fn(u32, u32) -> [u8; 3]) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("map.tif");
    write_map(&path, (80, 60), geo, pixel);
    (dir, path)
}

/// Longitude, latitude and degrees per pixel of a map in EPSG:4326.
fn degrees(lon: f64, lat: f64, size: [f64; 2]) -> Vec<Tag> {
    vec![
        double(33550, &[size[0], size[1], 0.0]),
        double(33922, &[0.0, 0.0, 0.0, lon, lat, 0.0]),
        short(
            34735,
            &[1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326],
        ),
    ]
}

fn metres(size_m: f64) -> Vec<Tag> {
    let mut tags = geo_tags(32632);
    tags[0] = double(33550, &[size_m, size_m, 0.0]);
    tags
}

#[test]
fn nothing_looks_wrong_with_a_usual_map() {
    let (_dir, path) = map(geo_tags(32632), colours);
    assert_eq!(found(&path, None).0, [""; 0]);
    // Square degrees at 60 degrees north: pixels twice as high as wide on the ground.
    let (_dir, path) = map(degrees(10.0, 60.0, [5e-6, 5e-6]), colours);
    assert_eq!(found(&path, None).0, [""; 0]);
}

#[test]
fn a_map_in_degrees_that_is_turned_is_sheared() {
    // Square degrees, turned by 45 degrees: pixels are rhombi on the ground, with sides of 79 degrees at 35 N and of 53 at 60 N.
    for (lat, off_deg) in [
        (20.0, None),
        (35.0, Some("11 degrees")),
        (60.0, Some("37 degrees")),
    ] {
        let mut tags = degrees(25.0, lat, [5e-6, 5e-6]);
        let side = 3e-6;
        let rows = [
            [side, side, 0.0, 25.0],
            [side, -side, 0.0, lat],
            [0.0; 4],
            [0.0, 0.0, 0.0, 1.0],
        ];
        // In place of scale and tie point.
        tags.drain(..2);
        tags.push(double(34264, rows.as_flattened()));
        let (_dir, path) = map(tags, colours);
        let (names, text) = found(&path, None);
        match off_deg {
            None => assert_eq!(names, [""; 0], "{text}"),
            Some(off_deg) => {
                assert_eq!(names, ["sheared"], "{text}");
                assert!(text.contains(off_deg), "{text}");
            }
        }
    }
}

#[test]
fn swapped_axes() {
    // 52 N, 5 E with pixels that are square there, written as latitude, longitude.
    let (_dir, path) = map(degrees(60.0, 5.0, [6e-6, 3e-6]), colours);
    let (names, text) = found(&path, None);
    assert_eq!(names, ["swapped_axes"], "{text}");
}

#[test]
fn degrees_taken_for_metres() {
    let (_dir, path) = map(degrees(8.5, 47.3, [5e-6, 5e-6]), colours);
    let (names, text) = found(&path, Some("EPSG:3857"));
    assert_eq!(names, ["degrees_as_metres", "source"], "{text}");
    assert!(text.contains("EPSG:4326"), "{text}");
}

#[test]
fn a_map_at_a_pole_is_not_one_in_degrees() {
    let mut tags = geo_tags(3031);
    tags[1] = double(33922, &[0.0, 0.0, 0.0, -20.0, 15.0, 0.0]);
    let (_dir, path) = map(tags, colours);
    let (names, text) = found(&path, None);
    assert_eq!(names, ["uneven_north"], "{text}");
}

#[test]
fn a_coordinate_system_in_place_of_another_that_the_file_states() {
    let (_dir, path) = map(geo_tags(32632), colours);
    assert_eq!(found(&path, Some("EPSG:32632")).0, [""; 0], "the same");
    let (names, text) = found(&path, Some("EPSG:32633"));
    assert_eq!(names, ["source"], "{text}");
    assert!(text.contains("EPSG:32632"), "{text}");
}

#[test]
fn an_empty_georeference() {
    let (_dir, path) = map(degrees(0.0, 0.0, [5e-6, 5e-6]), colours);
    assert_eq!(found(&path, None).0, ["null_island"]);
}

#[test]
fn half_black_and_half_without_data() {
    let half = |x: u32, y: u32| if x < 40 { [0; 3] } else { colours(x, y) };
    let (_dir, path) = map(geo_tags(32632), half);
    let (names, text) = found(&path, None);
    assert_eq!(names, ["black"]);
    assert!(text.contains("50 %") || text.contains("51 %"), "{text}");
    let mut tags = geo_tags(32632);
    tags.push(support::ascii(42113, "0"));
    let (_dir, path) = map(tags, half);
    assert_eq!(found(&path, None).0, ["no_data"]);
}

#[test]
fn one_colour() {
    let (_dir, path) = map(geo_tags(32632), |_, _| [90, 91, 90]);
    assert_eq!(found(&path, None).0, ["one_colour"]);
}

#[test]
fn implausible_resolutions() {
    let (_dir, path) = map(metres(10.0), colours);
    let (names, text) = found(&path, None);
    assert_eq!(names, ["resolution"]);
    assert!(text.contains("covers 15 pixels"), "{text}");
    let (_dir, path) = map(metres(0.001), colours);
    let (names, text) = found(&path, None);
    assert_eq!(names, ["resolution"]);
    assert!(text.contains("1.0 mm"), "{text}");
}

#[test]
fn a_resolution_that_changes_over_the_map() {
    // 6 degrees of latitude in Mercator.
    let mut tags = geo_tags(3857);
    tags[0] = double(33550, &[10_000.0, 10_000.0, 0.0]);
    tags[1] = double(33922, &[0.0, 0.0, 0.0, 1_000_000.0, 8_000_000.0, 0.0]);
    let (_dir, path) = map(tags, colours);
    let (names, text) = found(&path, None);
    assert_eq!(names, ["resolution", "uneven_resolution"], "{text}");
}

#[test]
fn what_the_crs_lacks() {
    let (_dir, path) = map(geo_tags(32632), colours);
    // Bessel's ellipsoid without a shift to WGS 84.
    let (names, text) = found(&path, Some("+proj=utm +zone=32 +ellps=bessel +units=m"));
    assert_eq!(names, ["source", "source"], "{text}");
    assert!(text.contains("hundreds of metres"), "{text}");
}
