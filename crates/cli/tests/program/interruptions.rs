//! Runs that end before their time keep what they have.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use predicates::prelude::PredicateBooleanExt as _;
use serde_json::Value;

use super::{PHOTOS, demo, grim, pack};
use crate::faults::noise_map;

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

/// Sends a signal by its name, such as `INT`.
#[cfg(unix)]
fn send(signal: &str, to: &Child) {
    let sent = Command::new("kill")
        .args([&format!("-{signal}"), &to.id().to_string()])
        .status()
        .unwrap();
    assert!(sent.success());
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
        send(signal, &child);
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

#[test]
#[cfg(unix)]
fn an_interrupted_calibration_goes_on_with_its_observations() {
    use std::io::Read as _;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    for (name, seed) in [("a", 1), ("b", 2)] {
        fs::create_dir(path(name)).unwrap();
        noise_map(Path::new(&path(&format!("{name}/picture.png"))), 900, seed);
    }
    let (a, b) = (path("a"), path("b"));
    let calibrate = |model: &str| {
        let options = "calibrate --worlds 0 --photos 6 --pictures";
        let words = options.split(' ').chain([&*a, &*b, "-o", model]);
        words.map(ToOwned::to_owned).collect::<Vec<_>>()
    };
    // Too few photos to fit anything, after all of them are localised.
    let to_the_end = |model: &str, observations: &str| {
        let mut command = grim();
        command.args(calibrate(model));
        command.args(["--observations", observations]);
        let kept = format!("kept in {model}.partial");
        command.assert().code(2).stderr(
            predicates::str::contains("right answers").and(predicates::str::contains(kept)),
        );
        fs::read_to_string(observations).unwrap()
    };
    let whole = to_the_end(&path("whole"), &path("whole.csv"));
    assert_eq!(whole.lines().count(), 1 + 28);

    let model = path("model");
    let partial = folder.path().join("model.partial");
    let arguments = calibrate(&model);
    let observations = path("model.csv");
    let mut words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    words.extend(["--observations", &observations]);
    let mut child = start(&words);
    assert!(wait_for_answers(&mut child, &partial, 500));
    send("INT", &child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let mut said = String::new();
    let mut stderr = child.stderr.take().unwrap();
    stderr.read_to_string(&mut said).unwrap();
    assert!(said.contains("the same command goes on"), "{said}");
    let kept = fs::metadata(&partial).unwrap().len();
    assert!(!Path::new(&model).exists() && kept > 500);

    assert_eq!(to_the_end(&model, &observations), whole);
    // It was added to: nothing was localised again.
    let uninterrupted = fs::read(path("whole.partial")).unwrap();
    let continued = fs::read(&partial).unwrap();
    assert_eq!(continued.len(), uninterrupted.len());
    // Without a file for them, they would be of no use.
    let mut alone = grim();
    alone
        .args(calibrate(&path("alone")))
        .assert()
        .code(2)
        .stderr(
            predicates::str::contains("only 7 right answers of one half of the scenes")
                .and(predicates::str::contains("kept in").not()),
        );
    // They are not written over what is kept.
    let mut other = grim();
    other
        .args(&arguments)
        .args(["--overwrite", "--observations"]);
    other.arg(path("model.partial")).assert().code(2).stderr(
        predicates::str::contains("--observations")
            .and(predicates::str::contains("a path of its own")),
    );
    assert_eq!(fs::read(&partial).unwrap(), continued);
}

#[test]
#[cfg(unix)]
fn an_interrupted_build_says_what_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let corners = noise_map(path("map.png").as_ref(), 3000, 1);
    let [map, pack] = ["map.png", "map.grim"].map(path);
    let build = ["map", "build", &map, "-o", &pack, corners[0], corners[1]];
    let mut child = start(&build);
    let partial = path("map.grim.partial");
    assert!(wait_for_answers(&mut child, partial.as_ref(), 1));
    send("INT", &child);
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130));
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(
        said.contains("map.grim.partial holds the work so far"),
        "{said}"
    );
    assert!(Path::new(&partial).exists() && !Path::new(&pack).exists());
}

#[test]
#[cfg(all(unix, feature = "train"))]
fn an_export_that_takes_long_ends_at_the_first_signal() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let config = path("training.toml");
    crate::faults::training::write_config(&config, 1, 2);
    // Pairs for the whitening that take hours.
    let text = fs::read_to_string(&config).unwrap();
    let text = text.replace("whitening_pairs = 0", "whitening_pairs = 10000000");
    let run = format!("out = '{}'", path("run").display());
    fs::write(&config, text.replace("out = \"run\"", &run)).unwrap();
    let mut child = start(&["train", config.to_str().unwrap()]);
    let curves = path("run").join("curves.csv");
    let started = Instant::now();
    let ends = |child: &mut Child| child.try_wait().unwrap();
    // The last of its two steps.
    while !fs::read_to_string(&curves).is_ok_and(|text| text.lines().count() == 3) {
        assert!(started.elapsed() < Duration::from_secs(120), "no steps");
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_secs(2));
    assert!(ends(&mut child).is_none(), "the export was over");
    send("TERM", &child);
    let sent = Instant::now();
    let status = loop {
        if let Some(status) = ends(&mut child) {
            break status;
        }
        if sent.elapsed() > Duration::from_secs(20) {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("the export goes on");
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert_eq!(status.code(), Some(130));
    assert!(path("run").join("checkpoint.safetensors").exists());
    assert!(!path("run").join("model.safetensors").exists());
}
