//! The maps of these tests, and what GDAL says of them.

use std::path::{Path, PathBuf};

use grimnet_geo::{GeoError, LonLat, MapOptions, MapPx, Raster, WindowPx, distance_m, open_map};
use serde_json::Value;

/// JPEG decoders differ by this much.
const JPEG_TOLERANCE: u8 = 6;

pub fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/sources")
}

pub fn path_of(name: &str) -> PathBuf {
    folder().join("maps").join(name)
}

pub fn open(name: &str) -> Box<dyn Raster> {
    open_map(&path_of(name), &MapOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"))
}

pub fn refused(path: &Path) -> GeoError {
    match open_map(path, &MapOptions::default()) {
        Ok(map) => panic!("{} was opened: {}", path.display(), map.describe()),
        Err(error) => error,
    }
}

pub fn golden(file: &str) -> Value {
    let text = std::fs::read(folder().join("golden.json")).unwrap();
    let golden: Value = serde_json::from_slice(&text).unwrap();
    let maps = golden["maps"].as_array().unwrap().clone();
    maps.into_iter().find(|m| m["file"] == file).unwrap()
}

/// Compares place, size and pixels with GDAL's of `file`.
pub fn check(name: &str, map: &dyn Raster, file: &str) {
    let golden = golden(file);
    let number = |value: &Value| value.as_f64().unwrap();
    let size = &golden["size_px"];
    assert_eq!(
        map.size_px(),
        (number(&size[0]) as u64, number(&size[1]) as u64),
        "{name}"
    );
    for point in golden["points"].as_array().unwrap() {
        let px = MapPx::new(number(&point["x_px"]), number(&point["y_px"]));
        let truth = LonLat::new(number(&point["lon_deg"]), number(&point["lat_deg"]));
        let ours = map.georeference().lonlat_from_map_px(px).unwrap();
        let off_m = distance_m(ours, truth);
        assert!(off_m < 1e-3, "{name} {px:?}: {off_m} m from {truth:?}");
    }
    for entry in golden["windows"].as_array().unwrap() {
        let [x, y, w, h] = [0, 1, 2, 3].map(|i| number(&entry["window"][i]));
        let patch = map
            .read(WindowPx::new(x, y, w, h), w as u32, h as u32)
            .unwrap();
        let picture = folder()
            .join("expected")
            .join(entry["expected"].as_str().unwrap());
        let expected = image::open(&picture).unwrap().to_rgba8();
        for (column, row, truth) in expected.enumerate_pixels() {
            let ours = patch.rgb.get_pixel(column, row).0;
            let off = (0..3).map(|i| ours[i].abs_diff(truth.0[i])).max().unwrap();
            assert!(
                off <= JPEG_TOLERANCE,
                "{name} window {x} {y}, pixel {column} {row}: {ours:?}, GDAL has {truth:?}"
            );
            if golden["has_mask"] == true {
                let seen = patch.valid.get_pixel(column, row).0[0];
                assert_eq!(
                    seen, truth.0[3],
                    "{name} window {x} {y}, pixel {column} {row}"
                );
            }
        }
    }
}

/// A copy of a folder of maps, to be changed.
pub fn copy_of(name: &str) -> (tempfile::TempDir, PathBuf) {
    fn copy(from: &Path, to: &Path) {
        if from.is_dir() {
            std::fs::create_dir(to).unwrap();
            for entry in std::fs::read_dir(from).unwrap() {
                let entry = entry.unwrap();
                copy(&entry.path(), &to.join(entry.file_name()));
            }
        } else {
            std::fs::copy(from, to).unwrap();
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    copy(&path_of(name), &path);
    (dir, path)
}
