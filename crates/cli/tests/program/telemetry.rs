//! Recorded telemetry that does not fit the flight of `grim demo`.

use std::fs;
use std::path::{Path, PathBuf};

use super::track::{frame, track};

#[test]
fn telemetry_that_stops_or_whose_clock_jumps_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("log.csv");
    let frames: Vec<PathBuf> = (1..=6).map(frame).collect();
    let sources: Vec<&Path> = frames.iter().map(PathBuf::as_path).collect();
    let told = |later: &str| {
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
    let stopped = told("");
    assert!(
        stopped
            .contains("log.csv: a frame comes 3.0 s after its last record, and no other follows"),
        "{stopped}"
    );
    let jumped = told("2026-06-21T11:00:02Z,115\n");
    assert!(
        jumped.contains("and the next is 3598.0 s newer"),
        "{jumped}"
    );
}

#[test]
fn a_yaw_of_another_convention_is_told_and_the_flight_is_found_without_it() {
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("log.csv");
    let frames: Vec<PathBuf> = (1..=8).map(frame).collect();
    let sources: Vec<&Path> = frames.iter().map(PathBuf::as_path).collect();
    let with_yaw = |yaw_deg: f64| {
        let row = |second: u32| format!("2026-06-21T10:00:{second:02}Z,{yaw_deg},0,0,115\n");
        let rows: String = (0..60).map(row).collect();
        fs::write(
            &csv,
            format!("time,yaw_deg,pitch_deg,roll_deg,height_agl_m\n{rows}"),
        )
        .unwrap();
        let (answers, errors, _) = track(&["--telemetry", csv.to_str().unwrap()], &sources);
        let last = answers.last().unwrap()["state"]
            .as_str()
            .unwrap()
            .to_owned();
        (last, errors)
    };
    let (state, errors) = with_yaw(98.8);
    assert_eq!(state, "tracking", "{errors}");
    assert!(!errors.contains("the yaw of the telemetry"), "{errors}");
    let (state, errors) = with_yaw(351.2);
    assert_eq!(state, "tracking", "{errors}");
    assert_eq!(
        errors
            .matches("degrees off the headings of the fixes")
            .count(),
        1,
        "{errors}"
    );
}
