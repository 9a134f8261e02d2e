//! Outputs that do not fit: the message names the file and the cause once, and what was there before is as it was.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use super::whole::{assert_whole, is_working_file};
use super::{contents, noise_map, observations};
use crate::{demo, pack};

fn grim() -> std::path::PathBuf {
    assert_cmd::cargo::cargo_bin("grim")
}

fn bash(script: &str, folder: &Path) -> Output {
    Command::new("bash")
        .args(["-c", script])
        .current_dir(folder)
        .env("GRIM", grim())
        .env("GRIM_LOG", "error")
        .output()
        .unwrap()
}

/// Commands that write into `out` files of at least 12 kB, with inputs in `inputs`; and a result of each.
fn commands(inputs: &Path, out: &str) -> Vec<(String, &'static str)> {
    let map = inputs.join("map.png");
    let [option, place] = noise_map(&map, 1100, 1);
    let observed = inputs.join("observed.csv");
    observations::write(&observed, 600);
    let (pack, map, demo) = (
        pack().display().to_string(),
        map.display().to_string(),
        demo().display(),
    );
    let files = |numbers: std::ops::RangeInclusive<usize>, stem: &str| {
        let file = |number| format!("{demo}/{stem}_{number:03}.jpg");
        numbers.map(file).collect::<Vec<_>>().join(" ")
    };
    let photos = files(1..=8, "photos/flight");
    let frames = files(1..=28, "flight/frame");
    vec![
        (
            format!("map build {map} {option} {place} --gsd 0.25 -o {out}/area.grim"),
            "area.grim",
        ),
        (
            format!("map info {pack} --map {demo}/map.tif --draw {out}/tiles.png"),
            "tiles.png",
        ),
        (
            format!(
                "locate --pack {pack} {photos} --format geojson -o {out}/answers.json --overwrite"
            ),
            "answers.json",
        ),
        (
            format!("track --pack {pack} {frames} -o {out}/track.jsonl --overwrite"),
            "track.jsonl",
        ),
        (
            format!(
                "calibrate --observed {} -o {out}/model.safetensors --overwrite",
                observed.display()
            ),
            "model.safetensors",
        ),
    ]
}

#[test]
fn a_full_device_is_named_by_every_command() {
    let inputs = tempfile::tempdir().unwrap();
    for (command, name) in commands(inputs.path(), "OUT") {
        // Drawings have the format of their name.
        if name == "tiles.png" {
            continue;
        }
        let command = command.replace(&format!("OUT/{name}"), "/dev/full");
        let output = bash(&format!("exec \"$GRIM\" {command}"), inputs.path());
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{command}: {errors}");
        for words in ["/dev/full", "No space left"] {
            assert_eq!(errors.matches(words).count(), 1, "{command}: {errors}");
        }
    }
    // Standard output is full as well.
    for command in ["completions bash", "model info", "map info PACK --json"] {
        let command = command.replace("PACK", &pack().display().to_string());
        let output = bash(&format!("\"$GRIM\" {command} > /dev/full"), inputs.path());
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{command}: {errors}");
        assert!(errors.contains("No space left"), "{command}: {errors}");
    }
}

/// Files may have 8 KiB. Whether the shell ignores the signal that goes with it or not, the program sees the error.
#[test]
fn a_limit_on_the_size_of_files_leaves_the_earlier_results() {
    let inputs = tempfile::tempdir().unwrap();
    for (command, name) in commands(inputs.path(), ".") {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let whole = bash(&format!("\"$GRIM\" {command}"), folder);
        assert!(matches!(whole.status.code(), Some(0 | 1)), "{whole:?}");
        let before = contents(folder);
        assert_whole(&folder.join(name));
        // A pack of another resolution, or it would be built already; an existing drawing is somebody's.
        let command = command.replace("--gsd 0.25", "--gsd 0.2");
        let command = command.replace("tiles.png", "tiles.png --overwrite");
        for trap in ["trap '' XFSZ;", ""] {
            let output = bash(
                &format!("ulimit -c 0; ulimit -f 8; {trap} exec \"$GRIM\" {command}"),
                folder,
            );
            let errors = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{command}: {errors}");
            assert!(errors.contains(name), "{command}: {errors}");
            assert!(errors.contains("File too large"), "{command}: {errors}");
            for (path, bytes) in contents(folder) {
                if path.ends_with("answers.json.partial") {
                    let answers: Result<serde_json::Value, _> = serde_json::from_slice(&bytes);
                    assert!(answers.is_ok(), "{}", String::from_utf8_lossy(&bytes));
                }
                assert!(
                    before.get(&path) == Some(&bytes) || is_working_file(&path),
                    "{command}: {path:?} was changed"
                );
            }
        }
        // With room again it succeeds.
        let again = bash(&format!("\"$GRIM\" {command}"), folder);
        assert!(matches!(again.status.code(), Some(0 | 1)), "{again:?}");
        assert_whole(&folder.join(name));
    }
}

/// A part of a database cannot be read, so it is not said to hold the answers.
#[test]
#[cfg(feature = "sqlite")]
fn a_geopackage_that_does_not_fit_leaves_no_part_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let command = format!(
        "ulimit -c 0; ulimit -f 8; exec \"$GRIM\" locate --pack {} {}/photos/flight_001.jpg -o answers.gpkg",
        pack().display(),
        demo().display()
    );
    let output = bash(&command, folder.path());
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert!(
        errors.starts_with("grim: cannot write answers.gpkg: File too large"),
        "{errors}"
    );
    assert!(contents(folder.path()).is_empty());
}

/// A file system of memory that is full, in a name space of its own. It needs the right to mount, else it is skipped.
#[test]
#[cfg(target_os = "linux")]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn a_full_file_system_leaves_the_earlier_results() {
    let probe = "unshare -rm sh -c 'mount -t tmpfs -o size=64k none . ' 2>/dev/null || unshare -m sh -c 'mount -t tmpfs -o size=64k none .'";
    let folder = tempfile::tempdir().unwrap();
    if !bash(probe, folder.path()).status.success() {
        eprintln!("SKIPPED: this process may not mount file systems");
        return;
    }
    let own = bash("unshare -m true", folder.path()).status.success();
    let unshare = if own { "unshare -m" } else { "unshare -rm" };
    let inputs = tempfile::tempdir().unwrap();
    let full = folder.path().join("full");
    fs::create_dir(&full).unwrap();
    for (command, name) in commands(inputs.path(), full.to_str().unwrap()) {
        // One page is free when the earlier result and the filler are there.
        let script = format!(
            "set -e; mount -t tmpfs -o size=64m none '{full}'; printf earlier > '{full}/{name}'\n\
             free=$(df --output=avail -B1 '{full}' | tail -1); head -c $((free - 4096)) /dev/zero > '{full}/filler'\n\
             status=0; \"$GRIM\" {command} --overwrite 2> errors || status=$?\n\
             echo $status; cat '{full}/{name}'; echo; grep -c 'No space left' errors; grep -c '{name}' errors\n\
             rm '{full}/filler'; status=0; \"$GRIM\" {command} --overwrite > /dev/null 2> errors || status=$?\n\
             echo $status; cp '{full}/{name}' '{name}'",
            full = full.display()
        );
        let script = script.replace("--overwrite --overwrite", "--overwrite");
        fs::write(folder.path().join("script"), &script).unwrap();
        let output = bash(&format!("{unshare} bash script"), folder.path());
        let errors = fs::read_to_string(folder.path().join("errors")).unwrap_or_default();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let said: Vec<&str> = text.lines().collect();
        assert_eq!(
            said[..4],
            ["2", "earlier", "1", "1"],
            "{command}: {errors} {output:?}"
        );
        let status = said.last().copied();
        assert!(matches!(status, Some("0" | "1")), "{command}: {errors}");
        assert_whole(&folder.path().join(name));
    }
}
