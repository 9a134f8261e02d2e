//! Photos so far apart in time that between two of them the aircraft may be anywhere.

#![allow(clippy::unwrap_used)]

use grimnet_geo::{LonLat, destination_en_m};
use grimnet_track::{Input, Miss, PositionFix, TrackOptions, TrackState, Tracker};

const START: LonLat = LonLat::new(120.7, 24.2);
const INTERVAL_S: f64 = 30.0;

/// A fix of a flight to the east with 6 m/s, by `off_m` east and north of it.
fn fix_at(time_s: f64, off_m: [f64; 2], confidence: f64) -> Input {
    Input::Fix(PositionFix {
        time_s,
        lonlat: destination_en_m(START, 6.0 * time_s + off_m[0], off_m[1]),
        covariance_en_m2: [0.3, 0.0, 0.3],
        map_error_m: 1.0,
        heading_deg: Some(90.0),
        gsd_m: 0.05,
        confidence,
    })
}

/// The fix of a photo, by `off_m` north of the flight.
fn fix(photo: u32, off_m: f64) -> Input {
    fix_at(INTERVAL_S * f64::from(photo), [0.0, off_m], 0.998)
}

/// The states when each photo was taken.
fn states(photos: &[Input]) -> Vec<TrackState> {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    let state = |&photo: &Input| {
        tracker.push(photo).unwrap();
        tracker.point_at(photo.time_s()).unwrap().state
    };
    photos.iter().map(state).collect()
}

#[test]
fn once_believed_every_photo_with_a_fix_within_reach_is() {
    let photos: Vec<Input> = (0..12).map(|photo| fix(photo, 0.0)).collect();
    let states = states(&photos);
    assert_eq!(states[..2], [TrackState::Searching; 2]);
    assert_eq!(states[3..], [TrackState::Tracking; 9]);
}

#[test]
fn a_place_out_of_reach_needs_more_than_one_photo() {
    let mut photos: Vec<Input> = (0..6).map(|photo| fix(photo, 0.0)).collect();
    photos.push(fix(6, 4000.0));
    assert!(!states(&photos)[6].is_usable());
}

#[test]
fn two_photos_without_a_fix_say_nothing_against_the_next_but_three_do() {
    for (misses, expected) in [(2, TrackState::Tracking), (3, TrackState::Lost)] {
        let mut photos: Vec<Input> = (0..6).map(|photo| fix(photo, 0.0)).collect();
        photos.extend((1..=misses).map(|miss| {
            let time_s = INTERVAL_S * (5.0 + f64::from(miss) / f64::from(misses + 1));
            Input::Miss(Miss { time_s })
        }));
        photos.push(fix(6, 0.0));
        assert_eq!(*states(&photos).last().unwrap(), expected, "{misses}");
    }
}

#[test]
fn fixes_of_other_places_speak_against_the_next_as_frames_without_one_do() {
    // A photo a second: twelve of the place, then for half a minute each third one with a fix far away, each time elsewhere.
    let mut photos: Vec<Input> = (0..12)
        .map(|photo| fix_at(f64::from(photo), [0.0; 2], 0.998))
        .collect();
    assert_eq!(states(&photos).last(), Some(&TrackState::Tracking));
    photos.extend((1..=27).map(|photo| {
        let time_s = 11.0 + f64::from(photo);
        if photo % 3 == 0 {
            let (north, east) = (0.8 * f64::from(photo)).sin_cos();
            fix_at(time_s, [1500.0 * east, 1500.0 * north], 0.8)
        } else {
            Input::Miss(Miss { time_s })
        }
    }));
    photos.push(fix_at(39.0, [0.0, 250.0], 0.998));
    assert_eq!(states(&photos).last(), Some(&TrackState::Lost));
}
