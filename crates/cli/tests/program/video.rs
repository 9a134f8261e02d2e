//! `grim track` of a video, without any other program.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{demo, grim, pack, track::answers};

/// Ten frames of the demo's flight, one a second: `video/make_video.sh`.
const FLIGHT: &[u8] = include_bytes!("video/flight.mp4");
/// On the equator, where the demo is.
const METRES_PER_DEG: f64 = 111_320.0;

/// Follows the video; no program is on the PATH. Gives the lines, standard error and exit status.
fn track(video: &Path, arguments: &[&str]) -> (Vec<Value>, String, i32) {
    answers(
        grim()
            .env("PATH", "")
            .args(["track", "--fps", "1", "--hfov", "70", "--height-agl", "115"])
            .arg("--pack")
            .arg(pack())
            .args(arguments)
            .arg(video),
    )
}

#[test]
fn a_video_is_followed_without_ffmpeg() {
    let folder = tempfile::tempdir().unwrap();
    let video = folder.path().join("flight.mp4");
    fs::write(&video, FLIGHT).unwrap();
    let (answers, errors, code) = track(&video, &[]);
    assert_eq!((answers.len(), code, errors.as_str()), (10, 0, ""));
    for (second, answer) in answers.iter().enumerate() {
        assert_eq!(answer["time"], second as f64);
        assert_eq!(answer["frame"], "fix", "{answer}");
    }
    // After the header, a line for each frame.
    let truth = fs::read_to_string(demo().join("flight_truth.csv")).unwrap();
    let row: Vec<&str> = truth.lines().nth(10).unwrap().split(',').collect();
    assert_eq!(row[0], "frame_010.jpg");
    let offset_m = |name: &str, truth: &str| {
        let found = answers[9][name].as_f64().unwrap();
        (found - truth.parse::<f64>().unwrap()) * METRES_PER_DEG
    };
    let error_m = offset_m("lat_deg", row[1]).hypot(offset_m("lon_deg", row[2]));
    let radius_m = answers[9]["radius95_m"].as_f64().unwrap();
    assert!(
        error_m < radius_m.max(10.0),
        "{error_m} m, stated {radius_m} m"
    );
}

#[test]
fn what_does_not_fit_is_told_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Telemetry that is shorter than the video.
    fs::write(path("flight.mp4"), FLIGHT).unwrap();
    fs::write(path("short.csv"), "time,height_agl_m\n0,115\n1,115\n").unwrap();
    let telemetry = path("short.csv");
    let (answers, errors, code) = track(
        &path("flight.mp4"),
        &["--telemetry", telemetry.to_str().unwrap()],
    );
    assert_eq!((answers.len(), code), (10, 0));
    assert!(
        errors.contains("short.csv: ends at 1.0 s, and the video at 9.0 s"),
        "{errors}"
    );
    // A video that is cut off.
    fs::write(path("cut.mp4"), &FLIGHT[..FLIGHT.len() * 3 / 4]).unwrap();
    let (answers, errors, code) = track(&path("cut.mp4"), &[]);
    assert!((5..10).contains(&answers.len()), "{}", answers.len());
    assert_eq!(code, 0, "{errors}");
    assert!(errors.contains("cut.mp4 is truncated"), "{errors}");
    // Not decoded here, and there is no ffmpeg.
    for (name, bytes, expected) in [
        ("flight.mkv", FLIGHT, "`ffmpeg`, which could not be started"),
        (
            "text.mp4",
            &b"hello, hello"[..],
            "neither an MP4 nor a MOV file",
        ),
        ("empty.mp4", &b""[..], "has no index"),
    ] {
        fs::write(path(name), bytes).unwrap();
        let (_, errors, code) = track(&path(name), &[]);
        assert_eq!(code, 2, "{name}: {errors}");
        assert!(
            errors.contains(name) && errors.contains(expected),
            "{name}: {errors}"
        );
    }
    // Subtitles beside it that say nothing of use, as some drones write them.
    let subtitles = "1\n00:00:00,000 --> 00:00:01,000\n[latitude: 0.1] [altitude: 115.0]\n";
    fs::write(path("flight.SRT"), subtitles).unwrap();
    let (answers, errors, code) = track(&path("flight.mp4"), &[]);
    assert_eq!((answers.len(), code), (10, 0), "{errors}");
    assert!(
        errors.contains("flight.SRT: no attitude, height or velocity in it"),
        "{errors}"
    );
}
