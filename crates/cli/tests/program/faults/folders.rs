//! Folders that cannot be written, and two runs that write at once.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use predicates::prelude::*;
use predicates::str::contains;

use super::{noise_map, observations};
use crate::{demo, grim, lines, pack, photo};

/// Nobody may make files there, not even the superuser.
const READ_ONLY: &str = "/proc/self";

#[test]
#[cfg(target_os = "linux")]
fn a_folder_that_cannot_be_written_is_told_before_the_work() {
    let inputs = tempfile::tempdir().unwrap();
    let map = inputs.path().join("map.png");
    let [option, place] = noise_map(&map, 1100, 1);
    let observed = inputs.path().join("observed.csv");
    observations::write(&observed, 10);
    let (map, observed) = (map.display(), observed.display());
    let (pack, photo, demo) = (pack(), photo(1), demo().display());
    let (pack, photo) = (pack.display(), photo.display());
    let commands = [
        format!("map build {map} {option} {place} -o {READ_ONLY}/area.grim"),
        format!("map info {pack} --map {demo}/map.tif --draw {READ_ONLY}/tiles.png"),
        format!("locate --pack {pack} {photo} -o {READ_ONLY}/answers.jsonl"),
        format!("locate --pack {pack} {photo} --draw {READ_ONLY}/drawings"),
        format!("track --pack {pack} {photo} --fps 1 -o {READ_ONLY}/track.gpx"),
        format!("track --pack {pack} {photo} --fps 1 --record {READ_ONLY}/recorded"),
        format!("track --pack {pack} {photo} --fps 1 --report {READ_ONLY}/report"),
        format!("eval {demo} --out {READ_ONLY}/results"),
        format!("calibrate --observed {observed} -o {READ_ONLY}/model.safetensors"),
        format!(
            "calibrate -o {}/m --observations {READ_ONLY}/o.csv",
            inputs.path().display()
        ),
        format!("demo --out {READ_ONLY}/demo"),
        format!("man {READ_ONLY}/man1"),
    ];
    for command in commands {
        grim()
            .args(command.split_whitespace())
            .timeout(Duration::from_secs(60))
            .assert()
            .code(2)
            .stdout(predicate::str::is_empty())
            .stderr(contains(READ_ONLY));
    }
}

/// Starts a command and waits until a file or folder is there.
fn start_until(arguments: &[&str], sign: &Path) -> std::process::Child {
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("grim"))
        .args(arguments)
        .env("GRIM_LOG", "error")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while !sign.exists() {
        assert!(child.try_wait().unwrap().is_none(), "ended too early");
        assert!(started.elapsed() < Duration::from_secs(120));
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

#[test]
fn a_second_builder_of_a_pack_is_refused_and_the_first_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("map.png");
    let [option, place] = noise_map(&map, 1600, 1);
    let out = folder.path().join("area.grim");
    let (map, out) = (map.to_str().unwrap(), out.to_str().unwrap());
    let arguments = [
        "map", "build", map, option, place, "--gsd", "0.2", "-o", out,
    ];
    let first = start_until(&arguments, &folder.path().join("area.grim.partial"));
    grim()
        .args(arguments)
        .assert()
        .code(2)
        .stderr(contains("area.grim"));
    let first = first.wait_with_output().unwrap();
    assert!(first.status.success(), "{first:?}");
    grim().args(["map", "verify", out]).assert().success();
}

#[test]
fn a_second_run_into_a_folder_is_refused_and_the_first_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("results");
    let data = demo().to_str().unwrap();
    let arguments = [
        "eval",
        data,
        "--heading",
        "exif",
        "--out",
        out.to_str().unwrap(),
    ];
    let first = start_until(&arguments, &out.join("area.grim.partial"));
    grim()
        .args(arguments)
        .assert()
        .code(2)
        .stderr(contains("another run is writing into"));
    let first = first.wait_with_output().unwrap();
    assert!(first.status.success(), "{first:?}");
    assert!(out.join("summary.json").exists());
}

#[test]
fn two_runs_that_write_one_file_give_the_answers_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("answers.jsonl");
    let (pack, photos) = (pack(), demo().join("photos"));
    let arguments = [
        "locate",
        "--pack",
        pack.to_str().unwrap(),
        photos.to_str().unwrap(),
        "-o",
        out.to_str().unwrap(),
    ];
    let first = start_until(&arguments, &folder.path().join("answers.jsonl.partial"));
    let second = grim().args(arguments).output().unwrap();
    let first = first.wait_with_output().unwrap();
    let mut codes = [first.status.code(), second.status.code()];
    codes.sort();
    // Who ends last finds a file that was not there when it began.
    assert_eq!(codes, [Some(0), Some(2)], "{first:?} {second:?}");
    let text = fs::read_to_string(&out).unwrap();
    assert_eq!(lines(&text).len(), crate::PHOTOS);
}
