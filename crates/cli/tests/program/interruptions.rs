//! Runs that end before their time keep what they have.

#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::{PHOTOS, demo, pack};

/// A `grim` of which the test holds the process.
fn start(arguments: &[&str]) -> Child {
    Command::new(assert_cmd::cargo::cargo_bin("grim"))
        .args(arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn start_locate(format: &str, out: &Path) -> Child {
    let (pack, photos) = (pack(), demo().join("photos"));
    start(&[
        "locate",
        "--pack",
        pack.to_str().unwrap(),
        "--format",
        format,
        "--heading",
        "unknown",
        "--out",
        out.to_str().unwrap(),
        photos.to_str().unwrap(),
    ])
}

/// Waits until the file holds some answers. `false` if the run ended before.
fn wait_for_answers(child: &mut Child, partial: &Path, bytes: u64) -> bool {
    let started = Instant::now();
    while started.elapsed() < Duration::from_secs(120) {
        if fs::metadata(partial).is_ok_and(|metadata| metadata.len() >= bytes) {
            return true;
        }
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("no answer within two minutes");
}

#[test]
fn a_killed_run_leaves_its_answers() {
    let folder = tempfile::tempdir().unwrap();
    for (format, name) in [("jsonl", "a.jsonl"), ("geojson", "a.geojson")] {
        let out = folder.path().join(name);
        let partial = folder.path().join(format!("{name}.partial"));
        let mut child = start_locate(format, &out);
        assert!(
            wait_for_answers(&mut child, &partial, 500),
            "the run was over before it could be killed"
        );
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!out.exists());
        let text = fs::read_to_string(&partial).unwrap();
        if format == "geojson" {
            let whole: Value = serde_json::from_str(&text).unwrap();
            assert!(!whole["features"].as_array().unwrap().is_empty());
        } else {
            assert!(!super::lines(&text).is_empty());
        }
    }
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 2, "the partial files and nothing else");
}

#[test]
fn an_interrupted_run_completes_its_file() {
    let folder = tempfile::tempdir().unwrap();
    for (format, signal) in [("geojson", "INT"), ("kml", "TERM")] {
        let out = folder.path().join(format!("a.{format}"));
        let partial = folder.path().join(format!("a.{format}.partial"));
        let mut child = start_locate(format, &out);
        assert!(wait_for_answers(&mut child, &partial, 300));
        let sent = Command::new("kill")
            .args([&format!("-{signal}"), &child.id().to_string()])
            .status()
            .unwrap();
        assert!(sent.success());
        assert_eq!(child.wait().unwrap().code(), Some(130), "{format}");
        assert!(!partial.exists());
        let text = fs::read_to_string(&out).unwrap();
        let answers = if format == "geojson" {
            let whole: Value = serde_json::from_str(&text).unwrap();
            whole["features"].as_array().unwrap().len()
        } else {
            assert!(text.trim_end().ends_with("</kml>"));
            text.matches("<Placemark>").count()
        };
        assert!((1..=2 * PHOTOS).contains(&answers));
    }
}

/// Kills the program at moments spread over the time that a run takes.
fn kill_at_moments(arguments: &[&str], moments: u32, mut check: impl FnMut()) {
    let started = Instant::now();
    let mut whole = start(arguments);
    whole.wait().unwrap();
    check();
    let duration = started.elapsed();
    for moment in 0..moments {
        let mut child = start(arguments);
        std::thread::sleep(duration * (2 * moment + 1) / (2 * moments));
        // It may have ended by itself.
        let _ = child.kill();
        child.wait().unwrap();
        check();
    }
}

#[test]
fn a_killed_demo_leaves_whole_files_and_runs_again() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("photos")).unwrap();
    fs::write(folder.path().join("photos/mine.jpg"), "mine").unwrap();
    let path = folder.path().to_str().unwrap();
    let arguments = ["demo", "--photos", "2", "--out", path];
    kill_at_moments(&arguments, 6, || {
        let mine = fs::read(folder.path().join("photos/mine.jpg")).unwrap();
        assert_eq!(mine, b"mine");
        for name in ["summary.json", "fixes.jsonl"] {
            if let Ok(text) = fs::read_to_string(folder.path().join(name)) {
                for line in serde_json::Deserializer::from_str(&text).into_iter::<Value>() {
                    line.unwrap();
                }
            }
        }
        for name in ["photos/flight_001.jpg", "map.tif"] {
            let path = folder.path().join(name);
            if path.exists() {
                image::open(path).unwrap();
            }
        }
    });
    assert!(start(&arguments).wait().unwrap().success());
}
