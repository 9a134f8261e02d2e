//! The program as a user runs it, on a small flight of `grim demo`.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod damage;
mod determinism;
mod evaluation;
mod faults;
mod guide;
mod hints;
mod interruptions;
mod limits;
mod live;
mod maps;
mod outputs;
mod reference_pages;
#[cfg(feature = "serve")]
mod serve;
mod several_outputs;
mod spared_inputs;
mod telemetry;
mod track;
#[cfg(feature = "video")]
mod video;
mod words;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use assert_cmd::Command;
use predicates::prelude::*;
use predicates::str::contains;
use serde_json::Value;

/// Photos of the flight: few, since all tests share it.
const PHOTOS: usize = 8;

fn grim() -> Command {
    Command::cargo_bin("grim").unwrap()
}

/// A flight's folder, made once.
fn demo() -> &'static Path {
    static DEMO: OnceLock<PathBuf> = OnceLock::new();
    DEMO.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("flight");
        grim()
            .args(["demo", "--photos", &PHOTOS.to_string(), "--out"])
            .arg(&folder)
            .assert()
            .success()
            .stdout(contains("heading unknown"));
        folder
    })
}

fn photo(number: usize) -> PathBuf {
    demo().join(format!("photos/flight_{number:03}.jpg"))
}

fn pack() -> PathBuf {
    demo().join("area.grim")
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn lines(text: &str) -> Vec<Value> {
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// `grim locate` with the flight's pack: standard output and exit status.
fn locate(arguments: &[&str], photos: &[PathBuf]) -> (String, i32) {
    let output = grim()
        .arg("locate")
        .arg("--pack")
        .arg(pack())
        .args(arguments)
        .args(photos)
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    (text, output.status.code().unwrap())
}

#[test]
fn the_demo_leaves_everything_that_it_names_and_finds_the_photos() {
    for name in ["map.tif", "truth.csv", "area.grim", "report.html"] {
        assert!(demo().join(name).metadata().unwrap().len() > 0, "{name}");
    }
    let truth = std::fs::read_to_string(demo().join("truth.csv")).unwrap();
    assert!(truth.starts_with("photo,lat_deg,lon_deg,heading_deg,height_agl_m"));
    assert_eq!(truth.lines().count(), PHOTOS + 1);
    let summary = json(&demo().join("summary.json"));
    for mode in ["heading_known", "heading_unknown"] {
        let figures = &summary[mode];
        for name in [
            "frames",
            "fixes",
            "within_5m",
            "within_20m",
            "median_m",
            "ale_m",
        ] {
            assert!(figures[name].is_number(), "{mode}: {name}");
        }
        assert_eq!(figures["frames"], PHOTOS);
        assert!(figures["within_10m"].as_f64().unwrap() >= 0.85, "{figures}");
    }
    for name in ["fixes.jsonl", "fixes_unknown_heading.jsonl"] {
        let answers = lines(&std::fs::read_to_string(demo().join(name)).unwrap());
        assert_eq!(answers.len(), PHOTOS);
    }
    let pictures = std::fs::read_dir(demo().join("matches")).unwrap().count();
    assert!(pictures > 0);
}

#[test]
fn json_lines_keep_their_names() {
    let (text, status) = locate(&["--format", "jsonl"], &[photo(1), photo(2)]);
    assert_eq!(status, 0, "{text}");
    for answer in lines(&text) {
        assert_eq!(answer["state"], "fix");
        for name in [
            "lat_deg",
            "lon_deg",
            "heading_deg",
            "gsd_m",
            "radius95_m",
            "inliers",
        ] {
            assert!(answer[name].is_number(), "{name}");
        }
        assert_eq!(answer["covariance_en_m2"].as_array().unwrap().len(), 3);
        assert!(answer["time_ms"]["total"].as_f64().unwrap() > 0.0);
        assert!(!answer["used"].as_array().unwrap().is_empty());
        assert!(answer["reason"].is_null());
    }
}

#[test]
fn the_same_answer_on_any_number_of_threads() {
    let answers = |threads: &str| {
        let (text, _) = locate(&["--threads", threads], &[photo(3)]);
        let mut answer = lines(&text).remove(0);
        answer["time_ms"].take();
        answer
    };
    assert_eq!(answers("1"), answers("2"));
}

#[test]
fn every_format_is_well_formed() {
    let flight = demo().join("photos");
    let (csv, _) = locate(&["--format", "csv"], std::slice::from_ref(&flight));
    assert_eq!(csv.lines().count(), PHOTOS + 1);
    assert!(csv.starts_with("photo,state,"));
    let (geojson, _) = locate(&["--format", "geojson"], &[photo(1)]);
    assert_eq!(
        serde_json::from_str::<Value>(&geojson).unwrap()["type"],
        "FeatureCollection"
    );
    let (kml, _) = locate(&["--format", "kml"], &[photo(1)]);
    assert!(kml.contains("<kml") && kml.trim_end().ends_with("</kml>"));
    let (table, _) = locate(&["--format", "table"], &[photo(1)]);
    assert!(table.contains("flight_001.jpg"));
}

#[test]
fn what_the_user_knows_takes_the_place_of_metadata() {
    let truth = std::fs::read_to_string(demo().join("truth.csv")).unwrap();
    let row: Vec<&str> = truth.lines().nth(1).unwrap().split(',').collect();
    let (lat, lon, heading, height) = (row[1], row[2], row[3], row[4]);
    let near = format!("{lat},{lon},150");
    let known = [
        "--heading",
        heading,
        "--height-agl",
        height,
        "--hfov",
        "70",
        "--near",
        &near,
        "--check",
    ];
    let (text, status) = locate(&known, &[photo(1)]);
    assert_eq!(status, 0, "{text}");
    let answer = &lines(&text)[0];
    assert!(answer["check_m"].is_number());
    let off_deg = (answer["lat_deg"].as_f64().unwrap() - lat.parse::<f64>().unwrap()).abs();
    assert!(off_deg < 10.0 / 111_000.0, "{off_deg} degrees of latitude");

    let (text, status) = locate(&["--near", "52.5,13.4,100"], &[photo(1)]);
    assert_eq!(status, 1);
    assert!(lines(&text)[0]["reason"].as_str().unwrap().len() > 10);
}

#[test]
fn one_bad_photo_leaves_the_others_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let whole = std::fs::read(photo(1)).unwrap();
    let (cut, text, empty) = ("cut.jpg", "text.jpg", "empty.jpg");
    std::fs::write(folder.path().join(cut), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(folder.path().join(text), "not a picture").unwrap();
    std::fs::write(folder.path().join(empty), "").unwrap();
    let bad = [cut, text, empty].map(|name| folder.path().join(name));
    let photos = [&bad[..], &[photo(1)]].concat();
    let (output, status) = locate(&[], &photos);
    assert_eq!(status, 2, "unreadable input");
    let answers = lines(&output);
    for (answer, path) in answers.iter().zip(&bad) {
        assert_eq!(answer["state"], "no_fix");
        let reason = answer["reason"].as_str().unwrap();
        assert!(reason.contains(path.to_str().unwrap()), "{reason}");
    }
    assert_eq!(answers[3]["state"], "fix");
}

#[test]
fn a_photo_of_nothing_has_no_fix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fog.png");
    image::RgbImage::from_pixel(800, 600, image::Rgb([190, 192, 195]))
        .save(&path)
        .unwrap();
    let (text, status) = locate(&["--gsd", "0.2"], &[path]);
    assert_eq!(
        (status, &lines(&text)[0]["state"]),
        (1, &Value::from("no_fix"))
    );
}

#[test]
fn pictures_and_answers_go_where_they_are_asked() {
    let folder = tempfile::tempdir().unwrap();
    let answers = folder.path().join("answers.csv");
    let arguments = [
        "--format".as_ref(),
        "csv".as_ref(),
        "--out".as_ref(),
        answers.as_os_str(),
        "--draw".as_ref(),
        folder.path().as_os_str(),
        "--map".as_ref(),
        demo().join("map.tif").as_os_str(),
    ]
    .map(|a: &std::ffi::OsStr| a.to_str().unwrap().to_owned());
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let (_, status) = locate(&arguments, &[photo(1)]);
    assert_eq!(status, 0);
    assert_eq!(std::fs::read_to_string(answers).unwrap().lines().count(), 2);
    let drawn = image::open(folder.path().join("flight_001.jpg")).unwrap();
    assert!(drawn.width() > 600);
}

#[test]
fn wrong_use_and_unreadable_input_end_with_2_and_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("x.grim");
    let picture = folder.path().join("plain.png");
    image::RgbImage::from_pixel(600, 600, image::Rgb([90, 120, 80]))
        .save(&picture)
        .unwrap();
    let fails = |arguments: &[&str], says: &str| {
        grim()
            .args(arguments)
            .assert()
            .code(2)
            .stderr(contains(says));
    };
    let out = out.to_str().unwrap();
    fails(&["map", "build", "/no/such.tif", "-o", out], "/no/such.tif");
    fails(
        &["map", "build", picture.to_str().unwrap(), "-o", out],
        "--corners",
    );
    let photo = photo(1);
    let photo = photo.to_str().unwrap();
    fails(
        &["locate", "--pack", "/no/such.grim", photo],
        "/no/such.grim",
    );
    fails(&["locate", "--pack", photo, photo], photo);
    let pack = pack();
    let pack = pack.to_str().unwrap();
    fails(
        &["locate", "--pack", pack, photo, "--heading", "north"],
        "exif",
    );
    fails(&["locate", "--pack", pack, photo, "--hfov", "200"], "hfov");
    fails(&["model", "info", photo], photo);
    fails(&["demo", "--photos", "0"], "from 1 to 100000");
    assert!(!Path::new(out).exists());
}

#[test]
fn a_pack_tells_what_it_holds_and_is_not_built_twice() {
    grim()
        .args(["map", "info"])
        .arg(pack())
        .assert()
        .success()
        .stdout(contains("EPSG:").and(contains("tiles")));
    let output = grim()
        .args(["map", "info", "--json"])
        .arg(pack())
        .output()
        .unwrap();
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(info.is_object());
    grim()
        .args(["map", "verify"])
        .arg(pack())
        .assert()
        .success()
        .stdout(contains("whole"));
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("tiles.png");
    grim()
        .args(["map", "info"])
        .arg(pack())
        .arg("--map")
        .arg(demo().join("map.tif"))
        .arg("--draw")
        .arg(&picture)
        .assert()
        .success();
    assert!(image::open(picture).unwrap().width() > 100);
    grim()
        .args(["map", "build"])
        .arg(demo().join("map.tif"))
        .arg("-o")
        .arg(pack())
        .assert()
        .success()
        .stdout(contains("already built"));
}

#[test]
fn the_bundled_model_tells_what_it_was_trained_and_calibrated_on() {
    let calibrated = contains("calibrated on").and(contains("photos of half of the places"));
    grim()
        .args(["model", "info"])
        .assert()
        .success()
        .stdout(contains("compact").and(contains("MIT OR Apache-2.0")))
        .stdout(calibrated.and(contains("confidence of 10.4 %")));
    let output = grim().args(["model", "info", "--json"]).output().unwrap();
    let info: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(info["calibration"]["fitted_on"]["data"].is_string());
}
