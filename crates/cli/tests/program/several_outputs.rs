//! Commands with several outputs, and standard output as one of them.

use std::fs;
use std::path::Path;

use predicates::prelude::*;
use predicates::str::contains;

use super::track::frame;
use super::{grim, lines, pack, photo};

#[test]
fn outputs_that_meet_are_refused_before_anything_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let frame = fs::canonicalize(frame(1)).unwrap().display().to_string();
    let photo = fs::canonicalize(photo(1)).unwrap().display().to_string();
    // There is no such pack.
    let track = format!("track --pack no.grim {frame}");
    let locate = format!("locate --pack no.grim {photo}");
    for (command, options, first, second) in [
        (&track, "--report r --record r", "--report", "--record"),
        (
            &track,
            "--report r --record ./x/../r",
            "--report",
            "--record",
        ),
        (&track, "-o a.html --session a.html", "--out", "--session"),
        (&track, "-o r --report r", "--out", "--report"),
        (
            &track,
            "--report r --session r/report.html",
            "--report",
            "--session",
        ),
        (
            &track,
            "--record r --session r/flight.jsonl",
            "--record",
            "--session",
        ),
        (
            &track,
            "--record r --session r/flight.jsonl.partial",
            "--record",
            "--session",
        ),
        (&track, "-o r/flight.jsonl --record r", "--out", "--record"),
        (&track, "-o a --nmea ./a", "--out", "--nmea"),
        (&track, "--nmea -", "--out", "--nmea"),
        (&locate, "-o d/flight_001.jpg --draw d", "--out", "--draw"),
        (&locate, "-o d --draw d", "--out", "--draw"),
        (
            &"calibrate".to_owned(),
            "-o m --observations m",
            "--out",
            "--observations",
        ),
    ] {
        grim()
            .current_dir(folder.path())
            .args(command.split_whitespace())
            .args(options.split_whitespace())
            .assert()
            .code(2)
            .stdout("")
            .stderr(
                contains("would both write")
                    .and(contains(first))
                    .and(contains(second)),
            );
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "{options}");
    }
}

#[test]
fn several_outputs_may_share_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let track = || {
        let mut track = grim();
        track
            .current_dir(folder.path())
            .args([
                "track",
                "-o",
                "r/track.gpx",
                "--record",
                "r",
                "--nmea",
                "r/a.nmea",
                "--pack",
            ])
            .arg(fs::canonicalize(pack()).unwrap())
            .arg(fs::canonicalize(frame(1)).unwrap());
        track
    };
    track()
        .assert()
        .code(2)
        .stderr(contains("the folder r does not exist"));
    fs::create_dir(folder.path().join("r")).unwrap();
    track().assert().code(predicate::in_iter([0, 1]));
    for name in ["track.gpx", "flight.jsonl", "a.nmea"] {
        assert!(folder.path().join("r").join(name).is_file(), "{name}");
    }
}

/// Runs `grim` in an empty folder: standard output. No file of the name `-` is made.
fn written(arguments: &[&str], inputs: &[&Path], status: i32) -> String {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs.iter().map(|path| fs::canonicalize(path).unwrap());
    let assert = grim()
        .current_dir(folder.path())
        .args(arguments)
        .arg("--pack")
        .args(
            [fs::canonicalize(pack()).unwrap()]
                .into_iter()
                .chain(inputs),
        )
        .assert()
        .code(status);
    assert!(!folder.path().join("-").exists(), "{arguments:?}");
    String::from_utf8(assert.get_output().stdout.clone()).unwrap()
}

#[test]
fn a_hyphen_is_standard_output_where_text_is_written() {
    let answers = written(&["locate", "-o", "-"], &[&photo(1)], 0);
    assert_eq!(lines(&answers)[0]["state"], "fix");
    let csv = written(&["locate", "-o", "-", "--format", "csv"], &[&photo(1)], 0);
    assert!(csv.starts_with("photo,state,"), "{csv}");
    let frames: Vec<_> = (1..=8).map(frame).collect();
    let frames: Vec<&Path> = frames.iter().map(|path| path.as_path()).collect();
    let track = written(&["track", "-o", "-"], &frames, 0);
    assert_eq!(lines(&track).len(), 8);
    let sentences = written(&["track", "-o", "track.gpx", "--nmea", "-"], &frames, 0);
    assert!(sentences.starts_with("$G"), "{sentences}");
    // A recording that runs again.
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().display().to_string();
    let again = written(&["track", "--record", &recording], &frames[..1], 1);
    grim()
        .current_dir(folder.path())
        .args(["track", "--replay", &recording, "-o", "-"])
        .assert()
        .success()
        .stdout(again);
    #[cfg(feature = "sqlite")]
    for (command, input) in [("locate", photo(1)), ("track", frame(1))] {
        let arguments = [command, "-o", "-", "--format", "gpkg"];
        assert_eq!(written(&arguments, &[&input], 2), "", "{command}");
    }
}

#[test]
fn a_hyphen_is_refused_where_no_text_is_written() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        "map build map.tif -o -",
        "map check map.tif --draw -",
        "map info area.grim --map map.tif --draw -",
        "locate -p area.grim a.jpg --draw -",
        "track -p area.grim a.jpg --session -",
        "track -p area.grim a.jpg --report -",
        "track -p area.grim a.jpg --record -",
        "calibrate -o -",
        "calibrate -o m --observations -",
        "eval data --out -",
        "demo --out -",
        "man -",
    ] {
        grim()
            .current_dir(folder.path())
            .args(arguments.split_whitespace())
            .assert()
            .code(2)
            .stdout("")
            .stderr(contains("standard output").and(contains("expected the path")));
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}
