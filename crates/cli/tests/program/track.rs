//! `grim track`, on the flight of `grim demo`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use predicates::prelude::*;
use predicates::str::contains;
use serde_json::Value;

use super::{demo, grim, lines, pack, photo};

fn flight() -> PathBuf {
    demo().join("flight")
}

pub(super) fn frame(number: usize) -> PathBuf {
    flight().join(format!("frame_{number:03}.jpg"))
}

/// `grim track` with the flight's pack: the lines, standard error and exit status.
pub(super) fn track(arguments: &[&str], source: &[&Path]) -> (Vec<Value>, String, i32) {
    answers(
        grim()
            .arg("track")
            .arg("--pack")
            .arg(pack())
            .args(arguments)
            .args(source),
    )
}

/// Runs `grim track`: the lines, standard error and exit status.
pub(super) fn answers(command: &mut assert_cmd::Command) -> (Vec<Value>, String, i32) {
    let output = command.output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    (lines(&text), errors, output.status.code().unwrap())
}

#[test]
fn the_demo_ends_with_a_flight_that_is_followed() {
    let text = fs::read_to_string(demo().join("track.jsonl")).unwrap();
    let answers = lines(&text);
    assert_eq!(answers.len(), 36);
    let followed = answers.iter().filter(|a| a["lat_deg"].is_number()).count();
    assert!(followed >= 24, "{followed}");
    for answer in &answers {
        for name in [
            "time",
            "state",
            "lat_deg",
            "lon_deg",
            "heading_deg",
            "radius95_m",
            "covariance_en_m2",
            "age_of_last_fix_s",
            "photo",
        ] {
            assert!(answer.get(name).is_some(), "{name}");
        }
        assert!(
            answer["time"]
                .as_str()
                .unwrap()
                .starts_with("2026-06-21T10:00:")
        );
    }
    let page = fs::read_to_string(demo().join("track.html")).unwrap();
    assert!(page.contains("<ellipse") && page.contains("data:image/jpeg"));
    assert!(
        page.contains("<td>confidently wrong</td><td>0</td>"),
        "the figures"
    );
    let gpx = fs::read_to_string(demo().join("track.gpx")).unwrap();
    assert_eq!(gpx.matches("<trkpt").count(), followed);
}

#[test]
fn a_flight_is_recorded_and_runs_again_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let recorded = folder.path().join("recorded");
    let report = folder.path().join("report");
    let record = recorded.to_str().unwrap();
    let truth = demo().join("flight_truth.csv");
    let (answers, errors, status) = track(
        &[
            "--record",
            record,
            "--truth",
            truth.to_str().unwrap(),
            "--report",
            report.to_str().unwrap(),
        ],
        &[&flight()],
    );
    assert_eq!(status, 0, "{errors}");
    assert_eq!(answers.len(), 36);
    assert!(errors.contains("median error"), "{errors}");
    assert!(report.join("report.html").is_file());
    // Without photos and map.
    let again = grim()
        .args(["track", "--replay", record])
        .assert()
        .success();
    let text = String::from_utf8(again.get_output().stdout.clone()).unwrap();
    assert_eq!(lines(&text), answers);
    let path = recorded.join("flight.jsonl");
    let text = fs::read_to_string(&path).unwrap();
    // A later one that was interrupted within a line is taken instead, and the other one by its name.
    let interrupted = recorded.join("flight.jsonl.partial");
    let torn: String = text.split_inclusive('\n').take(6).collect();
    fs::write(&interrupted, &torn[..torn.len() - 9]).unwrap();
    let replayed = |recording: &Path| {
        let mut command = grim();
        super::track::answers(command.args(["track", "--replay"]).arg(recording))
    };
    let (again, errors, status) = replayed(&recorded);
    assert_eq!(status, 0, "{errors}");
    assert!((1..6).contains(&again.len()), "{errors}");
    assert_eq!(again, answers[..again.len()]);
    let taken = format!("{} is replayed", interrupted.display());
    assert!(errors.contains(&taken), "{errors}");
    assert!(errors.contains(path.to_str().unwrap()), "{errors}");
    assert!(errors.contains("incomplete"), "{errors}");
    let (again, errors, status) = replayed(&path);
    assert_eq!((&again, status), (&answers, 0), "{errors}");
    let same = format!("{} frames, all as they were recorded\n", answers.len());
    assert_eq!(errors, same);
    // None of them is replaced by the track.
    for own in [&path, &interrupted] {
        grim()
            .args(["track", "--overwrite", "--replay", record, "-o"])
            .arg(own)
            .assert()
            .code(2)
            .stderr(contains("input"));
    }
    // Of one that is damaged the track so far is kept, and it is said where.
    fs::write(&interrupted, torn + "{}\n").unwrap();
    let csv = folder.path().join("again.csv");
    grim()
        .args(["track", "--replay", record, "-o"])
        .arg(&csv)
        .assert()
        .code(2)
        .stderr(contains("the track so far is in").and(contains("again.csv.partial")));
    assert!(!csv.exists());
    fs::remove_file(&interrupted).unwrap();
    // One changed number is noticed.
    fs::write(
        &path,
        text.replacen("\"confidence\":0.9", "\"confidence\":0.1", 9),
    )
    .unwrap();
    grim()
        .args(["track", "--replay", record])
        .assert()
        .code(1)
        .stderr(contains("than the recorded one"));
}

/// The session that a page holds.
#[cfg(feature = "serve")]
fn session(page: &Path) -> Value {
    let page = fs::read_to_string(page).unwrap();
    assert!(!page.contains("http://") && !page.contains("https://"));
    let (_, rest) = page.split_once("id=\"session\">").unwrap();
    let (json, _) = rest.split_once("</script>").unwrap();
    serde_json::from_str(json).unwrap()
}

#[cfg(all(feature = "serve", feature = "sqlite"))]
#[test]
fn a_track_is_a_geopackage_and_a_page_without_a_server() {
    let folder = tempfile::tempdir().unwrap();
    let [package, page] = ["flight.gpkg", "flight.html"].map(|name| folder.path().join(name));
    let frames: Vec<PathBuf> = (1..=8).map(frame).collect();
    let broken = folder.path().join("frame_009.jpg");
    fs::write(&broken, &fs::read(frame(9)).unwrap()[..20_000]).unwrap();
    let mut source: Vec<&Path> = frames.iter().map(PathBuf::as_path).collect();
    source.push(&broken);
    let map = demo().join("map.tif");
    let arguments = [
        "-o",
        package.to_str().unwrap(),
        "--session",
        page.to_str().unwrap(),
    ];
    let with_map = [&arguments[..], &["--map", map.to_str().unwrap()]].concat();
    let (lines, errors, status) = track(&with_map, &source);
    assert_eq!((lines.len(), status), (0, 1), "{errors}");
    let bytes = fs::read(&package).unwrap();
    assert!(bytes.starts_with(b"SQLite format 3\0"));
    assert_eq!(&bytes[68..72], b"GPKG");
    let shown = session(&page);
    let shown_frames = shown["frames"].as_array().unwrap();
    assert_eq!(shown_frames.len(), 9);
    let last = &shown_frames[7];
    assert_eq!(last["point"]["state"], "tracking", "{last}");
    assert!(last["point"]["radius95_m"].as_f64().unwrap() < 25.0);
    assert_eq!(last["number"], 8);
    assert_eq!(shown_frames[8]["answer"]["state"], "no_fix");
    let tiles = shown["tiles"].as_array().unwrap();
    let of_the_map = |tile: &&Value| {
        let picture = tile["picture"].as_str().unwrap();
        picture.starts_with("data:image/jpeg")
    };
    assert!(tiles.iter().filter(of_the_map).count() > 1);
    // Neither is replaced, nor an input.
    let (_, errors, status) = track(&arguments[..2], &source);
    assert_eq!(status, 2, "{errors}");
    let (_, errors, status) = track(&arguments[2..], &source);
    assert_eq!(status, 2, "{errors}");
    let (_, errors, status) = track(
        &[
            "--overwrite",
            "--session",
            map.to_str().unwrap(),
            "--map",
            map.to_str().unwrap(),
        ],
        &source,
    );
    assert_eq!(status, 2, "{errors}");
    assert!(errors.contains("input"), "{errors}");
    // Standard output takes no database.
    let (_, errors, status) = track(&["--format", "gpkg"], &source);
    assert_eq!(status, 2);
    assert!(errors.contains("-o FILE.gpkg"), "{errors}");
    // Without the map the outlines of the pack are shown.
    let plain = folder.path().join("plain.html");
    let (_, errors, _) = track(&["--session", plain.to_str().unwrap()], &source[..1]);
    assert_eq!(
        session(&plain)["frames"].as_array().unwrap().len(),
        1,
        "{errors}"
    );
}

#[test]
fn bad_frames_are_told_in_a_line_each_and_stop_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for number in 1..=10 {
        fs::copy(
            frame(number),
            folder.path().join(format!("a{number:02}.jpg")),
        )
        .unwrap();
    }
    let bytes = fs::read(frame(11)).unwrap();
    fs::write(
        folder.path().join("truncated.jpg"),
        &bytes[..bytes.len() / 2],
    )
    .unwrap();
    fs::write(folder.path().join("words.jpg"), "no picture").unwrap();
    fs::copy(frame(3), folder.path().join("twice.jpg")).unwrap();
    let (answers, errors, status) = track(&[], &[folder.path()]);
    assert_eq!(status, 1, "{errors}");
    assert_eq!(answers.len(), 12, "one has no time");
    let of = |name: &str| {
        let named = |a: &&Value| a["photo"].as_str().unwrap().ends_with(name);
        answers.iter().find(named).unwrap()
    };
    assert_eq!(of("truncated.jpg")["frame"], "unusable");
    assert_eq!(of("a10.jpg")["state"], "tracking");
    for (name, count) in [("truncated.jpg", 1), ("words.jpg", 1)] {
        let lines = errors.lines().filter(|line| line.contains(name)).count();
        assert_eq!(lines, count, "{name}: {errors}");
    }
    assert!(
        errors.contains("have the time of the one before"),
        "{errors}"
    );
}

#[test]
fn photos_without_times_need_a_rate() {
    let folder = tempfile::tempdir().unwrap();
    let still = folder.path().join("a.png");
    image::RgbImage::new(40, 30).save(still).unwrap();
    let (answers, errors, status) = track(&[], &[folder.path()]);
    assert_eq!((answers.len(), status), (0, 2), "{errors}");
    assert!(
        errors.contains("a.png") && errors.contains("--fps"),
        "{errors}"
    );
    // The survey's photos all have one time.
    let (answers, _, _) = track(&["--fps", "0.1"], &[&photo(1), &photo(2)]);
    assert_eq!(answers[1]["time"], 10.0);
}

#[test]
#[cfg(target_os = "linux")]
fn frames_that_cannot_be_read_are_left_out_with_the_cause() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::copy(frame(1), path("a.jpg")).unwrap();
    fs::write(path("words.jpg"), "no picture").unwrap();
    let left_out = |errors: &str, name: &str| {
        let mut lines = errors.lines().filter(|line| line.contains("left out"));
        let line = lines.find(|line| line.contains(name)).unwrap_or_default();
        assert!(!line.contains("--fps"), "{errors}");
        line.to_owned()
    };
    let follow = ["--follow", "--idle", "1"];
    let (_, errors, status) = track(&follow, &[folder.path()]);
    assert_eq!(status, 1, "{errors}");
    assert!(
        left_out(&errors, "words.jpg").contains("decoded"),
        "{errors}"
    );
    // The system gives an error instead of the bytes of this file.
    std::os::unix::fs::symlink("/proc/self/mem", path("unreadable.jpg")).unwrap();
    let (_, of_folder, status) = track(&[], &[folder.path()]);
    assert_eq!(status, 1, "{of_folder}");
    let names =
        ["a.jpg", "words.jpg", "unreadable.jpg"].map(|name| path(name).display().to_string());
    let of_names = grim()
        .args(["track", "-", "--pack"])
        .arg(pack())
        .write_stdin(names.join("\n"))
        .output()
        .unwrap();
    let of_names = String::from_utf8(of_names.stderr).unwrap();
    for errors in [of_folder, of_names] {
        assert!(
            left_out(&errors, "words.jpg").contains("decoded"),
            "{errors}"
        );
        let line = left_out(&errors, "unreadable.jpg");
        assert!(line.contains("Input/output error"), "{errors}");
    }
    // Where nothing is left, the error names the first cause.
    let (_, errors, status) = track(&[], &[&path("words.jpg")]);
    assert_eq!(status, 2);
    assert!(
        errors.contains("none of the 1 photos has a time; the first, "),
        "{errors}"
    );
    assert!(!errors.contains("--fps"), "{errors}");
}

#[test]
fn a_folder_is_followed_while_it_is_written_to() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("track.geojson");
    let incoming = folder.path().join("incoming");
    fs::create_dir(&incoming).unwrap();
    let grim = assert_cmd::cargo::cargo_bin("grim");
    let follower = Command::new(grim)
        .args([
            "track",
            "--follow",
            "--idle",
            "4",
            "--most-wait",
            "60",
            "--pack",
        ])
        .arg(pack())
        .arg(&incoming)
        .arg("-o")
        .arg(&out)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    for number in 1..=8 {
        // Half of it first, as a slow card writes it.
        let bytes = fs::read(frame(number)).unwrap();
        let name = format!("2026062110_{number:04}_000.jpg");
        let path = incoming.join(name);
        fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        std::thread::sleep(Duration::from_millis(20));
        fs::write(&path, &bytes).unwrap();
    }
    let output = follower.wait_with_output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{errors}");
    let track: Value = serde_json::from_str(&fs::read_to_string(&out).unwrap()).unwrap();
    let features = track["features"].as_array().unwrap();
    assert_eq!(features.len(), 8, "{errors}");
    assert_eq!(features[7]["properties"]["state"], "tracking");
    assert_eq!(features[7]["properties"]["frame"], "fix");
}

/// A camera's program that fails, or the wrong folder.
#[test]
fn a_source_without_a_frame_is_told() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["-", "--fps", "1"][..],
        &[".", "--follow", "--idle", "0.1"],
    ] {
        grim()
            .current_dir(folder.path())
            .args(["track", "--pack"])
            .arg(pack())
            .args(arguments)
            .write_stdin("")
            .timeout(Duration::from_secs(60))
            .assert()
            .code(1)
            .stdout("")
            .stderr(contains("no frame came that can be used"));
    }
}

#[test]
fn frames_come_on_standard_input_as_pictures_or_as_names() {
    let mut pictures = Vec::new();
    let mut names = String::new();
    for number in 1..=3 {
        pictures.extend(fs::read(frame(number)).unwrap());
        names += &format!("{}\n", frame(number).display());
    }
    let run = |input: Vec<u8>| {
        let output = grim()
            .args(["track", "-", "--pack"])
            .arg(pack())
            .write_stdin(input)
            .output()
            .unwrap();
        lines(&String::from_utf8(output.stdout).unwrap())
    };
    let (of_pictures, of_names) = (run(pictures), run(names.into_bytes()));
    assert_eq!((of_pictures.len(), of_names.len()), (3, 3));
    for (a, b) in of_pictures.iter().zip(&of_names) {
        assert_eq!(a["time"], b["time"]);
        assert_eq!((&a["frame"], &b["frame"]), (&"fix".into(), &"fix".into()));
    }
}

/// Such as a name of another file, or of a photo that is gone.
#[test]
fn a_name_that_cannot_be_read_takes_no_telemetry_from_the_frames() {
    let folder = tempfile::tempdir().unwrap();
    let telemetry = folder.path().join("flight.csv");
    let rows = (0..60).map(|second| format!("2026-06-21T10:00:{second:02}Z,120\n"));
    let text = format!("time,height_agl_m\n{}", rows.collect::<String>());
    fs::write(&telemetry, text).unwrap();
    let names = (1..=10).map(|number| format!("{}\n", frame(number).display()));
    let names = format!("gone_20270101_000000.jpg\n{}", names.collect::<String>());
    let mut command = grim();
    command.args(["track", "-", "--pack"]).arg(pack());
    command.arg("--telemetry").arg(telemetry).write_stdin(names);
    let (lines, errors, status) = answers(&mut command);
    assert_eq!((lines.len(), status), (11, 1), "{errors}");
    assert_eq!(lines[0]["frame"], "unusable");
    assert_eq!(lines[10]["height_agl_m"], 120.0, "{errors}");
}

#[test]
fn a_name_that_cannot_be_read_says_nothing_of_the_time_of_day() {
    let mut command = grim();
    command.args(["track", "-", "--pack"]).arg(pack());
    command.args(["--nmea", "udpout:127.0.0.1:9"]);
    let (lines, errors, status) = answers(command.write_stdin("gone_1.5.jpg\n"));
    assert_eq!((lines.len(), status), (1, 1), "{errors}");
    assert_eq!(lines[0]["frame"], "unusable");
}

#[test]
fn a_smoothed_track_is_surer_than_the_live_one() {
    let sources: Vec<PathBuf> = (1..=14).map(frame).collect();
    let sources: Vec<&Path> = sources.iter().map(PathBuf::as_path).collect();
    let (live, ..) = track(&[], &sources);
    let (smoothed, errors, status) = track(&["--smooth"], &sources);
    assert_eq!(status, 0, "{errors}");
    let radius_m = |lines: &[Value], photo: &str| {
        let named = |a: &&Value| a["photo"].as_str().is_some_and(|p| p.ends_with(photo));
        lines
            .iter()
            .find(named)
            .and_then(|a| a["radius95_m"].as_f64())
    };
    let (live_m, smoothed_m) = (
        radius_m(&live, "frame_010.jpg").unwrap(),
        radius_m(&smoothed, "frame_010.jpg").unwrap(),
    );
    assert!(smoothed_m < live_m, "{smoothed_m} {live_m}");
    // The first frames were not believed yet when they came.
    assert!(radius_m(&live, "frame_001.jpg").is_none());
    assert!(radius_m(&smoothed, "frame_001.jpg").is_some());
}

/// Such as `head` behind a pipe, or a node of ROS that ends.
#[test]
fn a_flight_goes_on_for_its_other_outputs_where_nothing_reads_its_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let unread = |arguments: &[&str]| {
        let mut child = Command::new(assert_cmd::cargo::cargo_bin("grim"))
            .current_dir(folder.path())
            .args(["track", "--pack"])
            .arg(pack())
            .args(arguments)
            .args((1..=6).map(frame))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let errors = String::from_utf8(output.stderr).unwrap();
        (errors, output.status.code())
    };
    let (errors, status) = unread(&["--record", "recorded", "--nmea", "sentences.nmea"]);
    assert_eq!(status, Some(0), "{errors}");
    let warning = "nothing reads the rows of the track any more";
    assert_eq!(errors.matches(warning).count(), 1, "{errors}");
    let recording = fs::read_to_string(path("recorded/flight.jsonl")).unwrap();
    assert_eq!(recording.matches("\"frame\":{\"time_s\"").count(), 6);
    assert!(path("sentences.nmea").is_file());
    let (errors, status) = unread(&["--nmea", "-", "--out", "track.gpx"]);
    assert_eq!(status, Some(0), "{errors}");
    assert!(errors.contains("nothing reads the sentences of --nmea any more"));
    assert!(path("track.gpx").is_file());
    // There is nothing else to be done for anybody.
    let (errors, status) = unread(&[]);
    assert_eq!((errors.as_str(), status), ("", Some(0)));
}

#[test]
fn a_truth_of_another_flight_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("truth.csv");
    fs::write(&truth, "photo,gps_lat,gps_lon\nDJI_0001.JPG,24.25,120.5\n").unwrap();
    let frames: Vec<PathBuf> = (1..=3).map(frame).collect();
    let frames: Vec<&Path> = frames.iter().map(PathBuf::as_path).collect();
    let (_, errors, _) = track(&["--truth", truth.to_str().unwrap()], &frames);
    let warning = "names none of the 3 frames";
    assert_eq!(errors.matches(warning).count(), 1, "{errors}");
    let truth = demo().join("flight_truth.csv");
    let (_, errors, _) = track(&["--truth", truth.to_str().unwrap()], &frames);
    assert!(!errors.contains("names none"), "{errors}");
}

#[test]
fn wrong_use_is_told() {
    for (arguments, expected) in [
        (&["--follow", "a", "b"][..], "--follow expects one folder"),
        (&["a.mp4", "b.jpg"], "not several sources"),
        (&["gone.mp4"], "cannot read gone.mp4"),
        (&["--follow", "gone"], "expected a folder"),
        (&["--start", "120,24,9", "x.jpg"], "--start"),
        (&["--zoom", "17", "x.jpg"], "where the map of --map lies"),
        (
            &["--nmea", "udp:127.0.0.1:5000", "x.jpg"],
            "expected udpout:HOST:PORT",
        ),
        (
            &[
                "--follow",
                ".",
                "--mavlink",
                "udpout:127.0.0.1:9",
                "--dry-run",
                "--nmea",
                "udpout:127.0.0.1:9",
            ],
            "--dry-run sends nothing",
        ),
    ] {
        grim()
            .args(["track", "--pack"])
            .arg(pack())
            .args(arguments)
            .assert()
            .code(2)
            .stderr(contains(expected));
    }
    grim()
        .arg("track")
        .assert()
        .code(2)
        .stderr(contains("--pack"));
    grim()
        .args(["track", "--replay", "/no/such"])
        .assert()
        .code(2)
        .stderr(contains("recorded"));
}
