//! Maps put together at random: each gives a map on Earth that can be read, or an error that names a file.
//!
//! `PROPTEST_CASES` sets the number of inputs of each test (CONTRIBUTING.md, "Fuzzing").

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use std::path::Path;

use grimnet_geo::{MapOptions, open_map};
use image::{Rgb, RgbImage};
use proptest::collection::vec;
use proptest::prelude::*;
use support::usable::assert_usable;
use support::{Tag, ascii, double, short, write_map};

/// Inputs of each test in a normal run.
const CASES: u32 = 96;

/// Opens the map and uses it.
fn check(path: &Path, options: &MapOptions) {
    let map = match open_map(path, options) {
        Ok(map) => map,
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains("map."), "names no file: {text}");
            return;
        }
    };
    assert_usable(&*map);
}

/// A number that a parser may stumble over.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -180.0..180.0f64,
        -1e7..1e7f64,
        Just(0.0),
        Just(0.5),
        Just(-0.5),
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(1e300),
        Just(1e-300),
        any::<f64>(),
    ]
}

fn key_value() -> impl Strategy<Value = u16> {
    prop_oneof![
        Just(4326u16),
        Just(3857),
        Just(32632),
        Just(32651),
        Just(27700),
        Just(32767),
        Just(9001),
        Just(9002),
        Just(9102),
        Just(9105),
        0..64u16,
        any::<u16>(),
    ]
}

/// GeoTIFF keys (OGC 19-008r4, annex B): the known ones and any other, with values in place or in the other tags.
fn geokeys() -> impl Strategy<Value = Vec<[u16; 4]>> {
    let key = prop_oneof![
        Just(1024u16),
        Just(1025),
        Just(2048),
        Just(2049),
        Just(2050),
        Just(2052),
        Just(2054),
        Just(2055),
        Just(2056),
        Just(2057),
        Just(2059),
        Just(2061),
        Just(3072),
        Just(3074),
        Just(3075),
        Just(3076),
        Just(3077),
        3078..3096u16,
        any::<u16>(),
    ];
    let place = prop_oneof![
        4 => Just(0u16),
        1 => Just(34736),
        1 => Just(34737),
        1 => Just(34735),
        1 => any::<u16>(),
    ];
    let count = prop_oneof![Just(1u16), Just(3), any::<u16>()];
    vec((key, place, count, key_value()), 0..12).prop_map(|keys| {
        keys.into_iter()
            .map(|(key, place, count, value)| [key, place, count, value])
            .collect()
    })
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn geotiff_keys(
        keys in geokeys(),
        stated in prop_oneof![3 => Just(None), 1 => any::<u16>().prop_map(Some)],
        scale in vec(number(), 0..4),
        tie_point in vec(number(), 0..13),
        matrix in prop_oneof![3 => Just(vec![]), 1 => vec(number(), 0..17)],
        doubles in vec(number(), 0..12),
        text in "[ -~|]{0,40}",
        no_data in prop_oneof![Just(String::new()), Just("0".to_owned()), "[-0-9a-zA-Z. ]{0,12}"],
        rational in any::<bool>(),
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("map.tif");
        let mut directory = vec![1, 1, 0, stated.unwrap_or(keys.len() as u16)];
        directory.extend(keys.iter().flatten());
        let mut tags: Vec<Tag> = vec![short(34735, &directory)];
        // Half of them with a plausible place, so that the keys matter.
        if rational {
            tags.push(double(33550, &[0.5, 0.5, 0.0]));
            tags.push(double(33922, &[0.0, 0.0, 0.0, 500_000.0, 5_000_000.0, 0.0]));
        } else {
            tags.push(double(33550, &scale));
            tags.push(double(33922, &tie_point));
        }
        if !matrix.is_empty() {
            tags.push(double(34264, &matrix));
        }
        if !doubles.is_empty() {
            tags.push(double(34736, &doubles));
        }
        if !text.is_empty() {
            tags.push(ascii(34737, &text));
        }
        if !no_data.is_empty() {
            tags.push(ascii(42113, &no_data));
        }
        write_map(&path, (20, 12), tags, |x, y| [x as u8, y as u8, 99]);
        check(&path, &MapOptions::default());
    }

    #[test]
    fn world_files(
        lines in vec(prop_oneof![
            number().prop_map(|v| v.to_string()),
            Just("0.5".to_owned()),
            "[-+0-9.,eE \\t]{0,12}",
            "\\PC{0,8}",
        ], 0..9),
        crs in prop_oneof![Just("EPSG:32632".to_owned()), Just("EPSG:4326".to_owned()), "EPSG:[0-9]{1,6}", "\\+proj=[a-z]{1,6}( \\+(lat_0|lon_0|zone|units|k|x_0)=[-0-9.a-z]{1,8}){0,4}", "\\PC{0,12}"],
        ending in prop_oneof![Just("\n"), Just("\r\n"), Just("\r")],
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("map.png");
        RgbImage::from_pixel(20, 12, Rgb([10, 200, 30])).save(&path).unwrap();
        std::fs::write(dir.path().join("map.pgw"), lines.join(ending)).unwrap();
        let options = MapOptions { crs: Some(crs), ..MapOptions::default() };
        check_named_or_crs(&path, &options);
    }

    #[test]
    fn csv_mosaics(
        header in prop_oneof![
            3 => Just("filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon".to_owned()),
            1 => Just("Filename, LL_lon, LL_lat, UR_lon, UR_lat".to_owned()),
            1 => "[a-zA-Z_, ]{0,60}",
        ],
        rows in vec((
            prop_oneof![4 => Just("map.a.png".to_owned()), 1 => Just("map.b.png".to_owned()), 1 => "\\PC{0,8}"],
            vec(prop_oneof![number().prop_map(|v| v.to_string()), (60.0..60.01f64).prop_map(|v| v.to_string()), (22.0..22.01f64).prop_map(|v| v.to_string())], 0..6),
        ), 0..5),
        corners in prop_oneof![1 => Just(None), 1 => (60.0..60.001f64, 22.0..22.001f64).prop_map(Some)],
    ) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("map.csv");
        for name in ["map.a.png", "map.b.png"] {
            RgbImage::from_pixel(20, 12, Rgb([10, 200, 30])).save(dir.path().join(name)).unwrap();
        }
        let mut text = header + "\n";
        for (name, cells) in rows {
            let cells = match corners {
                Some((lat, lon)) => [lat, lon, lat - 0.001, lon + 0.002].iter().map(f64::to_string).collect(),
                None => cells,
            };
            text += &format!("{name},{}\n", cells.join(","));
        }
        std::fs::write(&path, text).unwrap();
        // Pictures that are not there are named by their own path.
        check_named_or_crs(&path, &MapOptions::default());
    }
}

/// As [`check`], where the error may name an option's value, or another file, instead of the map.
fn check_named_or_crs(path: &Path, options: &MapOptions) {
    match open_map(path, options) {
        Ok(_) => check(path, options),
        Err(error) => assert!(error.to_string().len() > 10, "{error}"),
    }
}
