//! Recorded telemetry that does not fit the flight of `grim demo`.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::track::{frame, track};

#[test]
fn telemetry_that_stops_or_whose_clock_jumps_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("log.csv");
    let frames: Vec<PathBuf> = (1..=6).map(frame).collect();
    let sources: Vec<&Path> = frames.iter().map(PathBuf::as_path).collect();
    let warnings = |later: &str| {
        let rows = "time,height_agl_m\n2026-06-21T10:00:00Z,115\n2026-06-21T10:00:01Z,115\n";
        fs::write(&csv, format!("{rows}{later}")).unwrap();
        let (answers, errors, _) = track(&["--telemetry", csv.to_str().unwrap()], &sources);
        assert_eq!(answers.len(), 6, "{errors}");
        assert_eq!(
            errors.matches("after its last record").count(),
            1,
            "{errors}"
        );
        errors
    };
    let stopped = warnings("");
    assert!(
        stopped
            .contains("log.csv: a frame comes 3.0 s after its last record, and no other follows"),
        "{stopped}"
    );
    let jumped = warnings("2026-06-21T11:00:02Z,115\n");
    assert!(
        jumped.contains("and the next is 3598.0 s newer"),
        "{jumped}"
    );
}

/// Follows frames with telemetry of these rows: the last state, the first answers with a position, and the errors.
fn followed(frames: usize, row: &str) -> (Vec<Value>, String) {
    followed_with(frames, row, &[])
}

fn followed_with(frames: usize, row: &str, others: &[&str]) -> (Vec<Value>, String) {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("log.csv");
    let frames: Vec<PathBuf> = (1..=frames).map(frame).collect();
    let sources: Vec<&Path> = frames.iter().map(PathBuf::as_path).collect();
    let rows: String = (0..60)
        .map(|second| format!("2026-06-21T10:00:{second:02}Z,{row}\n"))
        .collect();
    fs::write(
        &csv,
        format!("time,yaw_deg,pitch_deg,roll_deg,height_agl_m\n{rows}"),
    )
    .unwrap();
    let mut arguments = vec!["--telemetry", csv.to_str().unwrap()];
    arguments.extend(others);
    let (answers, errors, _) = track(&arguments, &sources);
    (answers, errors)
}

#[test]
fn a_yaw_of_another_convention_is_told_and_the_flight_is_found_without_it() {
    let (answers, errors) = followed(8, "98.8,0,0,115");
    assert_eq!(answers.last().unwrap()["state"], "tracking", "{errors}");
    assert!(!errors.contains("of the telemetry"), "{errors}");
    let (answers, errors) = followed(12, "351.2,0,0,115");
    assert_eq!(answers.last().unwrap()["state"], "tracking", "{errors}");
    let warnings = errors.matches("degrees off the headings of the fixes");
    assert_eq!(warnings.count(), 1, "{errors}");
}

#[test]
fn a_tilt_of_another_convention_is_told_and_the_radius_grows() {
    for (row, off) in [
        ("98.8,0,20,115", "+0 degrees of pitch and -20 of roll"),
        ("98.8,-90,0,115", "+90 degrees of pitch and +0 of roll"),
    ] {
        let (answers, errors) = followed(12, row);
        assert_eq!(errors.matches(off).count(), 1, "{errors}");
        let last = answers.last().unwrap();
        assert_eq!(last["state"], "tracking", "{errors}");
        assert!(last["radius95_m"].as_f64().unwrap() > 20.0, "{last}");
    }
}

#[test]
fn a_recorded_flight_whose_attitude_was_left_out_gives_the_same_track_again() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("recording");
    let arguments = ["--record", recording.to_str().unwrap()];
    let (answers, errors) = followed_with(10, "98.8,0,20,115", &arguments);
    assert!(errors.contains("the tilt of the telemetry"), "{errors}");
    let replay = ["--replay", recording.to_str().unwrap()];
    let (again, errors, status) = super::track::answers(super::grim().arg("track").args(replay));
    assert_eq!(status, 0, "{errors}");
    assert_eq!(again, answers);
}

#[test]
fn feet_and_heights_above_the_sea_are_told_and_the_flight_is_found_without_them() {
    for (height_m, factor) in [(377.3, "3.2"), (295.0, "2.5"), (55.0, "0.4")] {
        let (answers, errors) = followed(10, &format!("98.8,0,0,{height_m}"));
        let warnings = format!("the heights of the telemetry are {factor}");
        assert_eq!(errors.matches(&warnings).count(), 1, "{errors}");
        assert_eq!(answers.last().unwrap()["state"], "tracking", "{errors}");
    }
}

#[test]
fn a_stated_delay_of_the_telemetry_moves_its_times() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("log.csv");
    let rows = "time,height_agl_m\n2026-06-21T10:00:00Z,115\n2026-06-21T10:00:09Z,115\n";
    fs::write(&csv, rows).unwrap();
    let first = frame(1);
    let errors = |delay: &str| {
        let csv = csv.to_str().unwrap();
        let arguments = ["--telemetry", csv, "--telemetry-delay", delay];
        track(&arguments, &[first.as_path()]).1
    };
    assert!(!errors("0").contains("before the first frame"));
    assert!(errors("60").contains("before the first frame"));
}
