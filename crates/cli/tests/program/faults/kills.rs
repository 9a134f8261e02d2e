//! Kills at random moments of every command that writes files: what was there before is as it was or replaced as a whole, nothing that
//! is cut off has the name of a result, and the next run succeeds.
//!
//! `GRIM_KILLS` sets how often each command is killed, `GRIM_KILL_SEED` the moments.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::whole::{assert_whole, is_working_file};
use super::{contents, noise_map, observations};
use crate::{demo, pack, photo};

/// Kills of each command in a normal run.
const KILLS: u64 = 2;

/// A file that the program did not write, in each folder of results.
const FOREIGN: &str = "notes.txt";

fn from_environment(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// SplitMix64 (Steele, Lea, Flood 2014), as a share of 1.
fn random_share(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

fn start(arguments: &[String], folder: &Path) -> Child {
    Command::new(assert_cmd::cargo::cargo_bin("grim"))
        .args(arguments)
        .current_dir(folder)
        .env("GRIM_LOG", "error")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Runs to the end, which must be an exit status below 2, and gives how long it took.
fn run(arguments: &[String], folder: &Path) -> Duration {
    let started = Instant::now();
    let output = start(arguments, folder).wait_with_output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        matches!(output.status.code(), Some(0 | 1)),
        "{arguments:?}: {:?} {errors}",
        output.status
    );
    started.elapsed()
}

/// Starts a run and kills it after a while. Gives whether it was still running.
fn kill_after(arguments: &[String], folder: &Path, delay: Duration) -> bool {
    let mut child = start(arguments, folder);
    std::thread::sleep(delay);
    let was_running = child.try_wait().unwrap().is_none();
    // SIGKILL: nothing can be tidied up.
    child.kill().unwrap();
    child.wait().unwrap();
    was_running
}

/// A command that writes into the folder that it is started in.
struct Case {
    /// An earlier run with other results, which the killed one may replace.
    earlier: Vec<String>,
    /// The run that is killed.
    killed: Vec<String>,
    /// The run after the kill; by default the killed one again.
    again: Option<Vec<String>>,
    /// Results that are the same in every run; others hold times.
    same_bytes: &'static [&'static str],
}

fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(ToOwned::to_owned).collect()
}

impl Case {
    fn test(&self) {
        let expected_folder = tempfile::tempdir().unwrap();
        let time = run(&self.killed, expected_folder.path());
        let expected = contents(expected_folder.path());
        let mut state = from_environment("GRIM_KILL_SEED", 1);
        for _ in 0..from_environment("GRIM_KILLS", KILLS) {
            let folder = tempfile::tempdir().unwrap();
            let folder = folder.path();
            run(&self.earlier, folder);
            fs::write(folder.join(FOREIGN), "mine").unwrap();
            let before = contents(folder);
            let delay = time.mul_f64(random_share(&mut state));
            let was_running = kill_after(&self.killed, folder, delay);
            let text = format!("{:?} after {delay:?} ({was_running})", self.killed);
            check_after_kill(folder, &before, &expected, &text);
            run(self.again.as_ref().unwrap_or(&self.killed), folder);
            let after = contents(folder);
            for (name, bytes) in &expected {
                let path = folder.join(name);
                assert!(after.contains_key(name), "{text}: {name:?} is missing");
                assert_whole(&path);
                let name = name.file_name().unwrap().to_str().unwrap();
                if self.same_bytes.contains(&name) {
                    assert!(fs::read(path).unwrap() == *bytes, "{text}: {name} differs");
                }
            }
            assert_eq!(after[Path::new(FOREIGN)], b"mine", "{text}");
            // Answers of a killed run stay, as its help says; temporary files do not.
            let hidden = |name: &&PathBuf| {
                let name = name.file_name().unwrap().to_string_lossy();
                name.starts_with('.') || name.ends_with(".assembling")
            };
            let left: Vec<_> = after.keys().filter(hidden).collect();
            assert!(left.is_empty(), "{text}: {left:?}");
        }
    }
}

/// Every earlier file is there, and every file is an earlier one or a whole new one.
fn check_after_kill(
    folder: &Path,
    before: &std::collections::BTreeMap<PathBuf, Vec<u8>>,
    expected: &std::collections::BTreeMap<PathBuf, Vec<u8>>,
    text: &str,
) {
    let after = contents(folder);
    for name in before.keys() {
        // Only what the new run has no use for may be removed: photos of a longer demo.
        let is_obsolete = !expected.contains_key(name) && name != Path::new(FOREIGN);
        assert!(
            after.contains_key(name) || is_obsolete,
            "{text}: {name:?} is lost"
        );
    }
    for (name, bytes) in &after {
        if before.get(name) == Some(bytes) || is_working_file(name) {
            continue;
        }
        assert_whole(&folder.join(name));
    }
}

#[test]
fn of_a_pack_that_is_built() {
    let inputs = tempfile::tempdir().unwrap();
    let map = inputs.path().join("map.png");
    let [option, place] = noise_map(&map, 1100, 1);
    let build = |gsd: &str| {
        let map = map.display();
        words(&format!(
            "map build {map} {option} {place} --gsd {gsd} -o area.grim"
        ))
    };
    Case {
        earlier: build("0.5"),
        killed: build("0.25"),
        again: None,
        same_bytes: &["area.grim"],
    }
    .test();
}

#[test]
fn of_answers_with_drawings() {
    let locate = |photos: &str| {
        words(&format!(
            "locate --pack {} {photos} -o answers.jsonl --draw drawings --map {} --overwrite",
            pack().display(),
            demo().join("map.tif").display()
        ))
    };
    Case {
        earlier: locate(&photo(1).display().to_string()),
        killed: locate(&demo().join("photos").display().to_string()),
        again: None,
        same_bytes: &["flight_001.jpg", "flight_008.jpg"],
    }
    .test();
}

/// Frames of the demo's flight, as words of a command line.
fn flight(frames: std::ops::RangeInclusive<usize>) -> String {
    let frame = |number| format!("flight/frame_{number:03}.jpg");
    let frames: Vec<String> = frames
        .map(|number| demo().join(frame(number)).display().to_string())
        .collect();
    frames.join(" ")
}

#[test]
fn of_a_track_with_its_recording_and_report() {
    let track = |frames: std::ops::RangeInclusive<usize>| {
        words(&format!(
            "track --pack {} {} -o track.gpx --record recorded --report report --overwrite",
            pack().display(),
            flight(frames)
        ))
    };
    Case {
        earlier: track(1..=3),
        killed: track(4..=12),
        again: None,
        same_bytes: &["track.gpx"],
    }
    .test();
}

#[test]
fn of_a_track_with_nmea_sentences() {
    let track = |frames: std::ops::RangeInclusive<usize>| {
        words(&format!(
            "track --pack {} {} -o track.csv --nmea sentences.nmea --overwrite",
            pack().display(),
            flight(frames)
        ))
    };
    Case {
        earlier: track(1..=8),
        killed: track(4..=14),
        again: None,
        same_bytes: &["sentences.nmea"],
    }
    .test();
}

#[test]
fn of_an_evaluation() {
    let inputs = tempfile::tempdir().unwrap();
    fs::create_dir(inputs.path().join("photos")).unwrap();
    for number in [1, 2] {
        let name = format!("photos/flight_{number:03}.jpg");
        fs::copy(photo(number), inputs.path().join(name)).unwrap();
    }
    fs::copy(demo().join("truth.csv"), inputs.path().join("truth.csv")).unwrap();
    fs::copy(demo().join("map.tif"), inputs.path().join("map.tif")).unwrap();
    let eval = |heading: &str| {
        let data = inputs.path().display();
        words(&format!("eval {data} --heading {heading} --out results"))
    };
    Case {
        earlier: eval("exif"),
        killed: eval("unknown"),
        again: None,
        same_bytes: &["area.grim"],
    }
    .test();
}

#[test]
fn of_a_model_that_is_calibrated() {
    let inputs = tempfile::tempdir().unwrap();
    let observed = inputs.path().join("observed.csv");
    observations::write(&observed, 600);
    let calibrate = |data: &str| {
        let observed = observed.display();
        words(&format!(
            "calibrate --observed {observed} --data {data} -o model.safetensors --overwrite"
        ))
    };
    Case {
        earlier: calibrate("first"),
        killed: calibrate("second"),
        again: None,
        same_bytes: &["model.safetensors"],
    }
    .test();
}

#[test]
fn of_manual_pages() {
    Case {
        earlier: words("man pages"),
        killed: words("man pages"),
        again: None,
        same_bytes: &["grim.1", "grim-locate.1"],
    }
    .test();
}

#[test]
fn of_a_drawing_of_a_map() {
    let draw = |level: u32| {
        words(&format!(
            "map info {} --map {} --draw tiles.png --level {level} --overwrite",
            pack().display(),
            demo().join("map.tif").display()
        ))
    };
    Case {
        earlier: draw(0),
        killed: draw(0),
        again: None,
        same_bytes: &["tiles.png"],
    }
    .test();
}

#[test]
fn of_a_picture_of_a_map() {
    let inputs = tempfile::tempdir().unwrap();
    let maps = ["first.png", "second.png"].map(|name| inputs.path().join(name));
    let check = |map: &Path, seed: u32| {
        let [option, place] = noise_map(map, 1500, seed);
        let map = map.display();
        words(&format!(
            "map check {map} {option} {place} --draw picture.png --overwrite"
        ))
    };
    Case {
        earlier: check(&maps[0], 1),
        killed: check(&maps[1], 2),
        again: None,
        same_bytes: &["picture.png"],
    }
    .test();
}

/// A demo takes long: [`crate::outputs`] kills one at two moments in every run, this test at random ones.
#[test]
#[ignore = "takes a minute for each kill; set GRIM_KILLS"]
fn of_a_demo() {
    Case {
        earlier: words("demo --photos 2 -o demo"),
        killed: words("demo --photos 1 --seed 8 -o demo"),
        again: None,
        same_bytes: &["area.grim", "map.tif", "truth.csv"],
    }
    .test();
}

#[test]
#[cfg(feature = "train")]
fn of_a_training_run() {
    let inputs = tempfile::tempdir().unwrap();
    let configured = |name: &str, steps: u32| {
        let path = inputs.path().join(name);
        super::training::write_config(&path, 1, steps);
        path.display().to_string()
    };
    let (first, second) = (configured("first.toml", 1), configured("second.toml", 6));
    Case {
        earlier: words(&format!("train {first}")),
        killed: words(&format!("train {second} --overwrite")),
        // Whichever run the checkpoint is of, it is whole and the run goes on from it.
        again: Some(words(&format!("train {second} --resume"))),
        same_bytes: &[],
    }
    .test();
}

/// The service keeps its tracks in memory: nothing is written that a kill could cut off.
#[test]
#[cfg(feature = "serve")]
fn of_the_service_which_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(pack(), folder.path().join("area.grim")).unwrap();
    let before = contents(folder.path());
    let arguments = words("serve --pack area.grim --listen 127.0.0.1:0");
    assert!(kill_after(
        &arguments,
        folder.path(),
        Duration::from_millis(800)
    ));
    assert!(contents(folder.path()) == before);
}
