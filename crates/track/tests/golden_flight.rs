//! A recorded flight runs again, and the track is the one that was checked in.
//!
//! `golden/flight.jsonl` is a recording of `grim track --record` (`golden/make_flight.py`), of which the inputs are used;
//! `golden/flight_track.jsonl` is the track. When the filter is meant to answer otherwise, `GRIM_WRITE_TRACK=1 cargo test --release -p
//! grimnet-track --test golden_flight` writes it again: look at what has changed.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeMap;

use grimnet_track::{Input, TrackOptions, Tracker};
use serde_json::Value;

const FLIGHT: &str = include_str!("golden/flight.jsonl");
const TRACK: &str = include_str!("golden/flight_track.jsonl");
/// Where [`TRACK`] is written again.
const WRITE: &str = "GRIM_WRITE_TRACK";
/// Other mathematical libraries round otherwise, and the filter adds that up: share of a value, and absolute (0.1 mm in degrees).
const TOLERANCE: (f64, f64) = (1e-6, 1e-9);

fn parsed<T: serde::de::DeserializeOwned>(value: &Value) -> T {
    serde_json::from_value(value.clone()).unwrap()
}

/// The track at each frame of the recording.
fn replayed() -> Vec<Value> {
    let mut tracker: Option<Tracker> = None;
    let mut points = Vec::new();
    for line in FLIGHT.lines() {
        let entry: Value = serde_json::from_str(line).unwrap();
        if let Some(first) = entry.get("options") {
            let options: TrackOptions = parsed(&first["options"]);
            match (&mut tracker, options.focal_length_px) {
                (Some(tracker), Some(focal_length_px)) => {
                    tracker.set_focal_length_px(focal_length_px);
                }
                (Some(_), None) => {}
                (None, _) => tracker = Some(Tracker::new(options).unwrap()),
            }
            continue;
        }
        let tracker = tracker.as_mut().unwrap();
        if let Some(input) = entry.get("input") {
            tracker.push(parsed(input)).unwrap();
            continue;
        }
        let frame = &entry["frame"];
        for input in parsed::<Vec<Input>>(&frame["inputs"]) {
            tracker.push(input).unwrap();
        }
        let point = tracker.point_at(frame["time_s"].as_f64().unwrap());
        points.push(serde_json::to_value(point.unwrap()).unwrap());
    }
    points
}

/// Panics where two values differ by more than the tolerance.
fn assert_same(place: &str, found: &Value, expected: &Value) {
    match (found, expected) {
        (Value::Number(found), Value::Number(expected)) => {
            let (found, expected) = (found.as_f64().unwrap(), expected.as_f64().unwrap());
            let tolerance = TOLERANCE.0 * expected.abs() + TOLERANCE.1;
            let is_degrees = place.ends_with("lat_deg") || place.ends_with("lon_deg");
            let tolerance = if is_degrees { TOLERANCE.1 } else { tolerance };
            assert!(
                (found - expected).abs() <= tolerance,
                "{place} is {found}, and was {expected}"
            );
        }
        (Value::Object(found), Value::Object(expected)) => {
            assert!(found.keys().eq(expected.keys()), "{place}");
            for (name, value) in found {
                assert_same(&format!("{place} {name}"), value, &expected[name]);
            }
        }
        (Value::Array(found), Value::Array(expected)) => {
            assert_eq!(found.len(), expected.len(), "{place}");
            for (found, expected) in found.iter().zip(expected) {
                assert_same(place, found, expected);
            }
        }
        _ => assert_eq!(found, expected, "{place}"),
    }
}

#[test]
fn a_recorded_flight_gives_the_same_track() {
    let points = replayed();
    if std::env::var_os(WRITE).is_some() {
        let text: String = points.iter().map(|point| format!("{point}\n")).collect();
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/tests/golden/flight_track.jsonl"
        );
        std::fs::write(path, text).unwrap();
        return;
    }
    let expected: Vec<Value> = TRACK
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(points.len(), expected.len());
    for (number, (found, expected)) in points.iter().zip(&expected).enumerate() {
        assert_same(&format!("frame {number}:"), found, expected);
    }
}

/// The flight is found, coasts where its photos are cut off, and goes on.
#[test]
fn the_recorded_flight_is_found_and_coasts() {
    let mut states = BTreeMap::<String, usize>::new();
    for point in replayed() {
        *states.entry(parsed(&point["state"])).or_default() += 1;
    }
    assert!(states["coasting"] >= 4, "{states:?}");
    assert!(states["tracking"] >= 20, "{states:?}");
    assert_eq!(states.values().sum::<usize>(), 36);
}
