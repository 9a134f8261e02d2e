//! Faults of maps, and what is said about them.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod georeference;
mod jpeg;
mod pixels;
mod sidecars;
#[path = "../support/mod.rs"]
mod support;
mod tables;
mod units;

use std::path::{Path, PathBuf};

use grimnet_geo::{
    GeoError, LonLat, MapOptions, MapPx, Raster, RasterPatch, WindowPx, distance_m, open_map,
};
use image::{GrayImage, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use support::{
    Tag, ascii, double, geo_tags, long, long8, rgb_tags, short, write_at, write_bigtiff, write_map,
};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn open(path: &Path) -> Result<Box<dyn Raster>, GeoError> {
    open_map(path, &MapOptions::default())
}

/// The error, which must name the file and hold a word of advice.
#[track_caller]
fn refused(result: Result<Box<dyn Raster>, GeoError>, file: &Path, words: &[&str]) -> GeoError {
    let error = match result {
        Ok(map) => panic!("it was opened: {}", map.describe()),
        Err(error) => error,
    };
    let text = error.to_string();
    let name = file.file_name().unwrap().to_string_lossy();
    assert!(text.contains(name.as_ref()), "does not name {name}: {text}");
    for word in words {
        assert!(text.contains(word), "does not say '{word}': {text}");
    }
    error
}

fn with_corners(path: &Path, corners: [f64; 4]) -> Result<Box<dyn Raster>, GeoError> {
    open_map(
        path,
        &MapOptions {
            corners: Some(corners),
            ..MapOptions::default()
        },
    )
}

fn with_crs(path: &Path, crs: &str) -> Result<Box<dyn Raster>, GeoError> {
    open_map(
        path,
        &MapOptions {
            crs: Some(crs.to_string()),
            ..MapOptions::default()
        },
    )
}

fn colours(x: u32, y: u32) -> [u8; 3] {
    [(x * 5) as u8, (y * 7) as u8, (x + y) as u8]
}

fn picture(path: &Path, width: u32, height: u32) {
    RgbImage::from_fn(width, height, |x, y| Rgb(colours(x, y)))
        .save(path)
        .unwrap();
}

fn golden_map(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden/maps")
        .join(name)
}

fn table(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("map.csv");
    std::fs::write(&path, text).unwrap();
    path
}
