//! Photos so far apart in time that between two of them the aircraft may be anywhere.

#![allow(clippy::unwrap_used)]

use grimnet_geo::{LonLat, destination_en_m};
use grimnet_track::{Input, Miss, PositionFix, TrackOptions, TrackState, Tracker};

const START: LonLat = LonLat::new(120.7, 24.2);
const INTERVAL_S: f64 = 30.0;

/// The fix of a photo of a flight to the east with 6 m/s, by `off_m` north of it.
fn fix(photo: u32, off_m: f64) -> Input {
    let time_s = INTERVAL_S * f64::from(photo);
    Input::Fix(PositionFix {
        time_s,
        lonlat: destination_en_m(START, 6.0 * time_s, off_m),
        covariance_en_m2: [0.3, 0.0, 0.3],
        map_error_m: 1.0,
        heading_deg: Some(90.0),
        gsd_m: 0.05,
        confidence: 0.998,
    })
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
