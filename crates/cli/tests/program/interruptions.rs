//! Runs that end before their time keep what they have.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::{PHOTOS, demo, pack};

/// A `grim` of which the test holds the process.
pub fn start(arguments: &[&str]) -> Child {
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
#[cfg(unix)]
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
