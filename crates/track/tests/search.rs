//! The window in which the next frame is searched.

#![allow(clippy::unwrap_used)]

use grimnet_geo::{LonLat, destination_en_m, distance_m};
use grimnet_track::{
    Attitude, Height, Input, Miss, PositionFix, Start, TrackOptions, TrackState, Tracker, Velocity,
};

const START: LonLat = LonLat::new(120.7, 24.2);

fn fix(time_s: f64, place: LonLat) -> Input {
    Input::Fix(PositionFix {
        time_s,
        lonlat: place,
        covariance_en_m2: [1.0, 0.0, 1.0],
        map_error_m: 1.0,
        heading_deg: Some(90.0),
        gsd_m: 0.05,
        confidence: 0.99,
    })
}

/// Ten seconds to the east at 10 m/s; the camera looks 10 degrees ahead from 100 m.
fn tracked() -> Tracker {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    for frame in 0..20 {
        let time_s = 0.5 * f64::from(frame);
        tracker
            .push(Input::Attitude(Attitude {
                time_s,
                yaw_deg: 90.0,
                pitch_deg: 10.0,
                roll_deg: 0.0,
            }))
            .unwrap();
        tracker
            .push(Input::Height(Height {
                time_s,
                agl_m: 100.0,
                amsl_m: None,
            }))
            .unwrap();
        tracker
            .push(Input::Velocity(Velocity {
                time_s,
                east_m_s: 10.0,
                north_m_s: 0.0,
                sigma_m_s: 0.3,
            }))
            .unwrap();
        let seen_m = 10.0 * time_s + 100.0 * 10f64.to_radians().tan();
        tracker
            .push(fix(time_s, destination_en_m(START, seen_m, 0.0)))
            .unwrap();
    }
    tracker
}

#[test]
fn a_tracked_frame_has_one_small_window_around_the_image_centre() {
    let tracker = tracked();
    let search = tracker.search(10.0, 60.0);
    assert!(!search.whole_map);
    assert_eq!(search.windows.len(), 1);
    let window = search.windows[0];
    let expected = destination_en_m(START, 100.0 + 17.63, 0.0);
    assert!(distance_m(window.centre, expected) < 2.0, "{window:?}");
    assert!((60.0..80.0).contains(&window.radius_m), "{window:?}");
    let (heading_deg, side_deg) = window.heading_deg.unwrap();
    assert!(
        (heading_deg - 90.0).abs() < 1.0 && side_deg < 30.0,
        "{window:?}"
    );
    let (low_m, high_m) = window.gsd_m.unwrap();
    assert!(
        low_m < 0.0456 && high_m > 0.0549 && high_m < 0.06,
        "{window:?}"
    );
    // The aircraft itself is behind the image centre.
    let estimate = tracker.point_at(10.0).unwrap().estimate.unwrap();
    let aircraft = LonLat::new(estimate.lon_deg, estimate.lat_deg);
    assert!(
        distance_m(aircraft, destination_en_m(START, 100.0, 0.0)) < 2.5,
        "{estimate:?}"
    );
}

#[test]
fn misses_open_the_window_step_by_step_to_the_whole_map() {
    let mut tracker = tracked();
    let mut radius_m = tracker.search(10.0, 60.0).windows[0].radius_m;
    let mut whole = Vec::new();
    for miss in 0..20 {
        let time_s = 10.0 + 0.5 * f64::from(miss);
        tracker.push(Input::Miss(Miss { time_s })).unwrap();
        let search = tracker.search(time_s, 60.0);
        assert!(search.windows[0].radius_m >= radius_m);
        radius_m = search.windows[0].radius_m;
        whole.push(search.whole_map);
    }
    assert!(!whole[5] && whole[19], "{whole:?}");
    assert!(radius_m > 1000.0);
    // A fix closes it again.
    tracker
        .push(fix(20.0, destination_en_m(START, 217.63, 0.0)))
        .unwrap();
    assert!(!tracker.search(20.0, 60.0).whole_map);
}

#[test]
fn nothing_known_is_the_whole_map_and_a_start_is_a_window_too() {
    let tracker = Tracker::new(TrackOptions::default()).unwrap();
    let search = tracker.search(0.0, 60.0);
    assert!(search.whole_map && search.windows.is_empty());
    let options = TrackOptions {
        start: Some(Start {
            lonlat: START,
            radius95_m: 200.0,
        }),
        ..TrackOptions::default()
    };
    let mut tracker = Tracker::new(options).unwrap();
    let before = tracker.search(0.0, 60.0);
    assert_eq!(before.windows.len(), 1, "before any input too");
    assert!(distance_m(before.windows[0].centre, START) < 0.01);
    tracker.push(Input::Miss(Miss { time_s: 0.0 })).unwrap();
    let search = tracker.search(0.0, 60.0);
    assert_eq!(search.windows.len(), 1);
    assert!(search.windows[0].radius_m > 300.0 && search.whole_map);
    assert_eq!(tracker.point_at(0.0).unwrap().state, TrackState::Searching);
}

#[test]
fn a_wrong_start_is_given_up_for_fixes_that_agree() {
    let options = TrackOptions {
        start: Some(Start {
            lonlat: START,
            radius95_m: 100.0,
        }),
        ..TrackOptions::default()
    };
    let mut tracker = Tracker::new(options).unwrap();
    let there = destination_en_m(START, 3000.0, 0.0);
    for frame in 0..10 {
        tracker.push(fix(0.5 * f64::from(frame), there)).unwrap();
    }
    let point = tracker.point_at(5.0).unwrap();
    assert!(point.state.is_usable(), "{point:?}");
    let estimate = point.estimate.unwrap();
    assert!(distance_m(LonLat::new(estimate.lon_deg, estimate.lat_deg), there) < 5.0);
}

#[test]
fn a_frame_that_comes_after_newer_telemetry_is_searched_where_the_aircraft_was() {
    let mut tracker = tracked();
    tracker
        .push(Input::Velocity(Velocity {
            time_s: 11.5,
            east_m_s: 10.0,
            north_m_s: 0.0,
            sigma_m_s: 0.3,
        }))
        .unwrap();
    let window = tracker.search(10.0, 60.0).windows[0];
    let expected = destination_en_m(START, 100.0 + 17.63, 0.0);
    assert!(distance_m(window.centre, expected) < 2.0, "{window:?}");
}

#[test]
fn the_focal_length_can_be_given_until_the_first_fix() {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    tracker.push(Input::Miss(Miss { time_s: 0.0 })).unwrap();
    assert!(!tracker.set_focal_length_px(f64::NAN));
    assert!(tracker.set_focal_length_px(2000.0));
    tracker.push(fix(0.5, START)).unwrap();
    assert!(!tracker.set_focal_length_px(3000.0));
    assert_eq!(tracker.options().focal_length_px, Some(2000.0));
}
