//! A scene in the shape of AnyVisLoc (`golden/anyvisloc/make_golden.py`).

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use grimnet_eval::datasets::anyvisloc::{AnyVisLocError, is_scene, read};
use grimnet_photo::Photo;
use serde_json::Value;

/// A tenth of a millimetre on the ground.
const TOLERANCE_DEG: f64 = 1e-9;

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/anyvisloc")
}

fn expected() -> Value {
    serde_json::from_str(&std::fs::read_to_string(golden().join("expected.json")).unwrap()).unwrap()
}

fn assert_near(found: &[f64], expected: &Value) {
    let expected: Vec<f64> = serde_json::from_value(expected.clone()).unwrap();
    assert_eq!(found.len(), expected.len());
    for (found_deg, expected_deg) in found.iter().zip(&expected) {
        let off_deg = (found_deg - expected_deg).abs();
        assert!(off_deg < TOLERANCE_DEG, "{found:?}, {expected:?}");
    }
}

#[test]
fn a_scene_is_read_on_either_map() {
    let photos = tempfile::tempdir().unwrap();
    let scene = golden().join("Scene_07");
    assert!(is_scene(&scene) && !is_scene(&golden()));
    let expected = expected();
    let found = read(&scene, None, photos.path()).unwrap();
    assert_eq!(found.map, scene.join("aerial_map.png"));
    assert_near(&found.corners, &expected["corners"]["aerial"]);
    let frames = expected["frames"].as_array().unwrap();
    assert_eq!(found.frames.len(), frames.len());
    for (found, frame) in found.frames.iter().zip(frames) {
        assert_eq!(found.photo, frame["photo"].as_str().unwrap());
        assert_eq!(found.heading_deg, frame["heading_deg"].as_f64());
        let (centre, camera) = (
            found.centre_lat_lon_deg.unwrap(),
            found.gps_lat_lon_deg.unwrap(),
        );
        assert_near(&[centre.1, centre.0], &frame["centre"]);
        assert_near(&[camera.1, camera.0], &frame["camera"]);
    }
    let tilted = found.frames.iter().find(|f| f.photo == "L07_0002.jpg");
    assert_eq!(tilted.unwrap().tilt_deg, Some(40.0));
    assert_eq!(found.left_out.len(), 1);
    assert!(found.left_out[0].contains("L07_0003.npz: the camera is tilted 88 degrees from nadir"));

    let satellite = read(
        &scene,
        Some("any/satellite_map.png".as_ref()),
        photos.path(),
    )
    .unwrap();
    assert_near(&satellite.corners, &expected["corners"]["satellite"]);
    let error = read(&scene, Some("other.tif".as_ref()), photos.path()).unwrap_err();
    assert!(matches!(error, AnyVisLocError::NoMap { .. }));
    let text = error.to_string();
    assert!(
        text.contains("no map other.tif") && text.contains("aerial_map.png (aerial)"),
        "{text}"
    );
}

#[test]
fn photos_are_written_once_and_say_how_they_were_taken() {
    let photos = tempfile::tempdir().unwrap();
    let scene = golden().join("Scene_07");
    read(&scene, None, photos.path()).unwrap();
    let path = photos.path().join("L07_0002.jpg");
    let photo = Photo::open_full(&path).unwrap();
    assert_eq!(photo.image.dimensions(), (64, 48));
    assert_eq!(photo.metadata.calibrated_focal_px, Some(50.0));
    assert_eq!(photo.metadata.gimbal_pitch_deg, Some(-50.0));
    assert_eq!(photo.metadata.gimbal_yaw_deg, Some(45.0));
    assert_eq!(photo.metadata.relative_altitude_m, Some(60.0));
    std::fs::write(&path, b"kept").unwrap();
    read(&scene, None, photos.path()).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"kept");
}
