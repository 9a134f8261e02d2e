//! Outputs never replace what is read because of what the command line names, even with `--overwrite`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use predicates::prelude::*;
use predicates::str::contains;

use super::outputs::contents;
use super::track::frame;
use super::{demo, grim, lines, pack, photo};

const REFUSED: &str = "never replaces an input";

/// Runs `grim` in a folder, with `--overwrite`: it is refused, and changes nothing.
fn is_refused(folder: &Path, arguments: &str) {
    let before = contents(folder);
    grim()
        .current_dir(folder)
        .args(arguments.split_whitespace())
        .arg("--overwrite")
        .timeout(Duration::from_secs(120))
        .assert()
        .code(2)
        .stdout("")
        .stderr(contains(REFUSED));
    assert!(contents(folder) == before, "{arguments}");
}

fn pack_path() -> String {
    fs::canonicalize(pack()).unwrap().display().to_string()
}

/// The demo's map with a file beside it that describes it.
fn map_with_description(folder: &Path) -> PathBuf {
    let map = folder.join("map.tif");
    fs::copy(demo().join("map.tif"), &map).unwrap();
    let description = folder.join("map.tif.aux.xml");
    fs::write(description, "<PAMDataset></PAMDataset>").unwrap();
    map
}

#[test]
fn a_track_spares_what_it_reads_because_of_what_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("flight.mp4"), "a video").unwrap();
    fs::write(path("flight.SRT"), "its telemetry").unwrap();
    fs::create_dir(path("photos")).unwrap();
    fs::copy(frame(1), path("photos/1.jpg")).unwrap();
    map_with_description(folder.path());
    // One that was interrupted.
    fs::create_dir(path("recorded")).unwrap();
    fs::write(path("recorded/flight.jsonl.partial"), "{}").unwrap();
    let pack = pack_path();
    for arguments in [
        "flight.mp4 -o flight.SRT",
        "flight.mp4 --nmea flight.SRT",
        "photos -o photos/1.jpg",
        "photos --follow -o photos/1.jpg",
        "photos --follow --session photos/1.jpg",
        "photos -o map.tif.aux.xml --report report --map map.tif",
        "photos --nmea map.tif.aux.xml --report report --map map.tif",
    ] {
        is_refused(folder.path(), &format!("track --pack {pack} {arguments}"));
    }
    is_refused(
        folder.path(),
        "track --replay recorded -o recorded/flight.jsonl.partial",
    );
}

#[test]
fn photos_that_are_named_on_standard_input_are_spared() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::copy(frame(1), path("1.jpg")).unwrap();
    fs::copy(frame(2), path("2.jpg")).unwrap();
    // One that has no time is read as well.
    image::RgbImage::new(40, 30)
        .save(path("still.png"))
        .unwrap();
    let before = contents(folder.path());
    for (names, out, rows) in [
        ("1.jpg\n2.jpg\n", "2.jpg", 2),
        ("still.png\n", "still.png", 0),
    ] {
        grim()
            .current_dir(folder.path())
            .args(["track", "-", "--overwrite", "--format", "jsonl", "--pack"])
            .args([&pack_path(), "-o", out])
            .write_stdin(names)
            .assert()
            .code(2)
            .stderr(contains(REFUSED).and(contains(out)));
        let partial = path(&format!("{out}.partial"));
        let kept = fs::read_to_string(&partial).unwrap_or_default();
        assert_eq!(lines(&kept).len(), rows, "the track so far");
        if partial.exists() {
            fs::remove_file(partial).unwrap();
        }
        assert!(contents(folder.path()) == before, "{out}");
    }
}

#[test]
fn photos_that_come_into_a_followed_folder_are_spared() {
    let folder = tempfile::tempdir().unwrap();
    let (incoming, out) = (
        folder.path().join("incoming"),
        folder.path().join("mine.jpg"),
    );
    fs::create_dir(&incoming).unwrap();
    fs::copy(frame(1), &out).unwrap();
    let before = fs::read(&out).unwrap();
    let follower = Command::new(assert_cmd::cargo::cargo_bin("grim"))
        .args([
            "track",
            "--follow",
            "--idle",
            "3",
            "--overwrite",
            "--format",
            "jsonl",
            "--pack",
        ])
        .arg(pack())
        .arg(&incoming)
        .arg("-o")
        .arg(&out)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while !folder.path().join("mine.jpg.partial").exists() {
        assert!(started.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(5));
    }
    fs::hard_link(&out, incoming.join("20260621_100000_000.jpg")).unwrap();
    let output = follower.wait_with_output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert!(errors.contains(REFUSED), "{errors}");
    assert!(fs::read(&out).unwrap() == before);
}

/// A data set, its map with a description, and pictures of elsewhere.
fn data_set(folder: &Path) {
    fs::create_dir_all(folder.join("data/photos")).unwrap();
    fs::create_dir(folder.join("pictures")).unwrap();
    fs::copy(photo(1), folder.join("data/photos/flight_001.jpg")).unwrap();
    fs::copy(photo(2), folder.join("pictures/a.jpg")).unwrap();
    fs::copy(demo().join("truth.csv"), folder.join("data/truth.csv")).unwrap();
    map_with_description(&folder.join("data"));
}

#[test]
fn an_evaluation_spares_all_of_its_data_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    data_set(folder.path());
    let out = folder.path().join("out");
    for (name, input, options) in [
        ("frames.csv", "data/truth.csv", ""),
        ("summary.json", "data/map.tif.aux.xml", ""),
        ("recall.json", "data/map.tif", ""),
        ("area.grim", "data/photos/flight_001.jpg", ""),
        ("area.grim", "data/truth.csv", "--track"),
        ("elsewhere.csv", "pictures/a.jpg", "--elsewhere pictures"),
        (
            "elsewhere.json",
            "data/map.tif.aux.xml",
            "--elsewhere pictures",
        ),
    ] {
        fs::create_dir(&out).unwrap();
        fs::hard_link(folder.path().join(input), out.join(name)).unwrap();
        is_refused(folder.path(), &format!("eval data --out out {options}"));
        fs::remove_dir_all(&out).unwrap();
    }
    // Of the pictures that it draws, too.
    fs::create_dir_all(out.join("matches")).unwrap();
    let photo = folder.path().join("data/photos/flight_001.jpg");
    fs::hard_link(photo, out.join("matches/flight_001.jpg")).unwrap();
    is_refused(folder.path(), "eval data --out out");
}

#[test]
fn a_calibration_spares_its_data_and_pictures_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    data_set(folder.path());
    for arguments in [
        "-o data/truth.csv --datasets data",
        "-o data/photos/flight_001.jpg --datasets data",
        "-o data/map.tif.aux.xml --datasets data",
        "-o m --observations data/truth.csv --datasets data",
        "-o pictures/a.jpg --pictures pictures",
        "-o pictures/a.jpg --elsewhere pictures",
    ] {
        is_refused(folder.path(), &format!("calibrate {arguments}"));
    }
}
