//! What is said of arguments that are valid and yet most likely slips.

use std::fs;
use std::path::Path;

use predicates::str::contains;

use super::track::{frame, track};
use super::{demo, grim, pack, photo};

/// `grim locate` of a photo that is on the map: what it says, and its exit status.
fn said(arguments: &[&str], folder: &Path) -> (String, i32) {
    let output = grim()
        .current_dir(folder)
        .args(["locate", "--pack"])
        .arg(fs::canonicalize(pack()).unwrap())
        .args(arguments)
        .arg(fs::canonicalize(photo(1)).unwrap())
        .output()
        .unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    (errors, output.status.code().unwrap())
}

#[test]
fn an_area_off_the_map_and_photos_without_a_fix_are_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let (errors, status) = said(&["--near", "60,10,100", "-o", "fixes.gpx"], folder.path());
    assert_eq!(status, 1, "{errors}");
    assert!(errors.contains("latitude comes first"), "{errors}");
    assert!(
        errors.contains("1 of 1 photos have no fix; GPX leaves them out"),
        "{errors}"
    );
    let (errors, status) = said(&["-o", "fixes.jsonl"], folder.path());
    assert_eq!((errors.contains("fix"), status), (false, 0), "{errors}");
}

#[test]
fn a_pack_of_paper_mode_in_another_mode_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let pack = folder.path().join("paper.grim");
    grim()
        .args(["map", "build", "--mode", "paper"])
        .arg(demo().join("map.tif"))
        .arg("-o")
        .arg(&pack)
        .assert()
        .success();
    for (mode, is_told) in [("default", true), ("paper", false)] {
        let mut locate = grim();
        locate.args(["locate", "--mode", mode, "--pack"]);
        let output = locate.arg(&pack).arg(photo(1)).output().unwrap();
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(errors.contains("built in paper mode"), is_told, "{errors}");
    }
}

#[test]
fn an_ending_that_is_not_of_the_format_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let (errors, status) = said(&["-o", "fixes.shp"], folder.path());
    assert_eq!(status, 0, "{errors}");
    assert!(errors.contains("no format has this ending"), "{errors}");
    let (errors, status) = said(&["-o", "fixes.kml", "--format", "csv"], folder.path());
    assert_eq!(status, 0, "{errors}");
    assert!(
        errors.contains("--format csv is written into a file with the ending of kml"),
        "{errors}"
    );
    for arguments in [["-o", "fixes"], ["-o", "/dev/null"]] {
        let (errors, _) = said(&arguments, folder.path());
        assert!(!errors.contains("ending"), "{errors}");
    }
}

#[test]
fn a_track_on_the_map_of_another_pack_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other.png");
    image::RgbImage::from_pixel(640, 400, image::Rgb([90, 120, 60]))
        .save(&other)
        .unwrap();
    for option in ["--session", "--report"] {
        let out = folder.path().join("out");
        let map = other.to_str().unwrap();
        let corners = ["--corners", "13.400,52.500,13.404,52.5025"];
        let arguments = [&[option, out.to_str().unwrap(), "--map", map], &corners[..]].concat();
        let (_, errors, status) = track(&arguments, &[&frame(1)]);
        assert_eq!(status, 2, "{errors}");
        assert!(errors.contains("is not the map that"), "{errors}");
        assert!(!out.exists());
    }
}

#[test]
fn true_positions_off_the_map_are_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("truth.csv");
    fs::write(&truth, "photo,gps_lat,gps_lon\nframe_001.jpg,60.5,10.25\n").unwrap();
    let (_, errors, _) = track(&["--truth", truth.to_str().unwrap()], &[&frame(1)]);
    assert!(
        errors.contains("the first: latitude 60.5, longitude 10.25"),
        "{errors}"
    );
    let right = demo().join("flight_truth.csv");
    let (_, errors, _) = track(&["--truth", right.to_str().unwrap()], &[&frame(1)]);
    assert!(!errors.contains("latitude and longitude"), "{errors}");
}

#[test]
fn a_ground_resolution_of_another_unit_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    grim()
        .args(["map", "build", "--gsd", "60", "-o"])
        .arg(folder.path().join("coarse.grim"))
        .arg(demo().join("map.tif"))
        .assert()
        .success()
        .stderr(contains("less than one tile"));
}

#[test]
fn a_build_on_a_sheared_map_says_that_photos_get_no_fix_there() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::from_fn(64, 64, |x, y| {
        image::Rgb([(4 * x) as u8, (4 * y) as u8, 90])
    })
    .save(path("map.png"))
    .unwrap();
    // Degrees, turned by 45 of them at 60 north.
    fs::write(path("map.pgw"), "3e-6\n3e-6\n3e-6\n-3e-6\n25\n60\n").unwrap();
    let mut build = grim();
    build.args(["map", "build", "--crs", "EPSG:4326", "-o"]);
    build.args([path("map.grim"), path("map.png")]);
    build.assert().success().stderr(contains("it is sheared"));
}

#[test]
#[cfg(feature = "train")]
fn a_stage_that_makes_no_model_exports_none() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("shapes.toml");
    fs::write(config, "stage = \"shapes\"\nout = \"shapes\"\n").unwrap();
    let mut export = grim();
    export.current_dir(folder.path());
    export.args(["train", "shapes.toml", "--export"]);
    export.assert().code(2).stderr(contains("makes no model"));
}
