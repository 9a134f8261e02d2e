//! Telemetry that steps: what no aircraft can do moves no track without saying so.

#![allow(clippy::unwrap_used)]

use grimnet_geo::{LonLat, destination_en_m, distance_m};
use grimnet_track::{
    Attitude, Estimate, Height, Input, Miss, PositionFix, PositionOf, RelativeMotion, Start,
    TrackOptions, Tracker, Velocity, smooth,
};

const START: LonLat = LonLat::new(120.7, 24.2);
const GSD_M: f64 = 0.2;
const SPEED_M_S: f64 = 10.0;

/// What a photo shows whose centre is so far ahead of an aircraft that flies to the east.
fn seen_ahead(time_s: f64, ahead_m: f64) -> PositionFix {
    PositionFix {
        time_s,
        lonlat: destination_en_m(START, SPEED_M_S * time_s + ahead_m, 0.0),
        covariance_en_m2: [0.3, 0.0, 0.3],
        map_error_m: 1.0,
        heading_deg: Some(90.0),
        gsd_m: GSD_M,
        confidence: 0.99,
    }
}

fn fix(time_s: f64) -> Input {
    Input::Fix(seen_ahead(time_s, 0.0))
}

/// A camera that looks ahead by a pitch.
fn looking_ahead(time_s: f64, yaw_deg: f64, pitch_deg: f64) -> Input {
    Input::Attitude(Attitude {
        time_s,
        yaw_deg,
        pitch_deg,
        roll_deg: 0.0,
    })
}

fn attitude(time_s: f64) -> Input {
    looking_ahead(time_s, 90.0, 0.0)
}

fn height(time_s: f64, agl_m: f64) -> Input {
    Input::Height(Height {
        time_s,
        agl_m,
        amsl_m: None,
    })
}

fn velocity(time_s: f64, east_m_s: f64) -> Input {
    Input::Velocity(Velocity {
        time_s,
        east_m_s,
        north_m_s: 0.0,
        sigma_m_s: 0.5,
    })
}

/// The error of an estimate for an aircraft that flies to the east at a constant speed, metres.
fn error_m(estimate: &Estimate, time_s: f64) -> f64 {
    let place = LonLat::new(estimate.lon_deg, estimate.lat_deg);
    distance_m(place, destination_en_m(START, SPEED_M_S * time_s, 0.0))
}

/// Ten seconds with fixes, two a second, and five more without: velocities come four times a second. Gives the estimates of the latter
/// and their errors, metres.
fn flown_on(reported_m_s: impl Fn(f64) -> f64) -> Vec<(Estimate, f64)> {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    let mut after = Vec::new();
    for tick in 0..=60 {
        let time_s = 0.25 * f64::from(tick);
        let inputs = [
            attitude(time_s),
            height(time_s, 100.0),
            velocity(time_s, reported_m_s(time_s)),
        ];
        for input in inputs {
            tracker.push(input).unwrap();
        }
        if time_s > 10.0 {
            let estimate = tracker.point_at(time_s).unwrap().estimate.unwrap();
            after.push((estimate, error_m(&estimate, time_s)));
        } else if tick % 2 == 0 {
            tracker.push(fix(time_s)).unwrap();
        }
    }
    after
}

#[test]
fn a_single_impossible_velocity_moves_nothing() {
    let usual = flown_on(|_| SPEED_M_S);
    let single = flown_on(|time_s| if time_s == 12.0 { 110.0 } else { SPEED_M_S });
    assert!(!usual.is_empty() && usual.len() == single.len());
    for ((usual, _), (single, error_m)) in usual.iter().zip(&single) {
        assert!(*error_m < 2.0, "{single:?}");
        assert!(single.radius95_m < 1.1 * usual.radius95_m, "{single:?}");
    }
}

#[test]
fn a_velocity_that_steps_for_good_is_as_uncertain_as_the_step() {
    for step_m_s in [20.0, -40.0, 100.0] {
        let stepped = flown_on(|time_s| {
            if time_s < 12.0 {
                SPEED_M_S
            } else {
                SPEED_M_S + step_m_s
            }
        });
        for (estimate, error_m) in &stepped {
            assert!(
                *error_m < estimate.radius95_m,
                "{step_m_s}: {error_m} m, {estimate:?}"
            );
        }
        let (last, _) = stepped.last().unwrap();
        let reported_m_s = SPEED_M_S + step_m_s;
        assert!(
            (last.velocity_east_m_s - reported_m_s).abs() < 1.0,
            "{last:?}"
        );
    }
}

#[test]
fn fixes_tell_at_once_which_velocity_was_right() {
    for old_is_right in [true, false] {
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        for tick in 0..=52 {
            let time_s = 0.25 * f64::from(tick);
            let is_off = (time_s >= 10.0) == old_is_right;
            let off_m_s = if is_off { 30.0 } else { 0.0 };
            tracker.push(velocity(time_s, SPEED_M_S + off_m_s)).unwrap();
            // While velocities are wrong from the beginning, nothing is known.
            if tick % 2 == 0 && (old_is_right || time_s >= 10.0) {
                tracker.push(fix(time_s)).unwrap();
            }
        }
        let point = tracker.point_at(13.0).unwrap();
        assert!(point.state.is_usable(), "{point:?}");
        let estimate = point.estimate.unwrap();
        let off_m_s = estimate.velocity_east_m_s - SPEED_M_S;
        assert!(off_m_s.abs() < 2.0, "{estimate:?}");
        let error_m = error_m(&estimate, 13.0);
        assert!(error_m < estimate.radius95_m, "{error_m} m, {estimate:?}");
    }
}

/// Eight seconds with fixes, then motion between frames alone, while the reported height is 100 m and then as given.
fn tracked_by_motion(agl_m: impl Fn(f64) -> f64) -> Tracker {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    for frame in 0..=32 {
        let time_s = 0.5 * f64::from(frame);
        tracker.push(attitude(time_s)).unwrap();
        tracker.push(height(time_s, agl_m(time_s))).unwrap();
        if frame > 0 {
            let motion = RelativeMotion {
                from_time_s: time_s - 0.5,
                time_s,
                forward_px: 0.5 * SPEED_M_S / GSD_M,
                right_px: 0.0,
                turn_deg: 0.0,
                sigma_px: 0.1,
                surface_sigma_px: Some(0.0),
            };
            tracker.push(Input::Motion(motion)).unwrap();
        }
        if time_s < 8.0 {
            tracker.push(fix(time_s)).unwrap();
        }
    }
    tracker
}

#[test]
fn a_height_of_another_reference_changes_no_ground_resolution() {
    let stepped = tracked_by_motion(|time_s| if time_s < 8.0 { 100.0 } else { 60.0 });
    let estimate = stepped.point_at(16.0).unwrap().estimate.unwrap();
    let error_m = error_m(&estimate, 16.0);
    assert!(
        error_m < 8.0 && error_m < estimate.radius95_m,
        "{error_m} m, {estimate:?}"
    );
    let (low_m, high_m) = stepped.search(16.0, 60.0).windows[0].gsd_m.unwrap();
    assert!(low_m < GSD_M && GSD_M < high_m, "{low_m} {high_m}");
    let usual = tracked_by_motion(|_| 100.0);
    let (usual_low_m, usual_high_m) = usual.search(16.0, 60.0).windows[0].gsd_m.unwrap();
    assert!(
        high_m / low_m > 1.02 * usual_high_m / usual_low_m,
        "less certain"
    );
}

#[test]
fn a_tilted_view_is_not_displaced_by_a_height_of_another_reference() {
    // The camera looks 15 degrees ahead from 100 m.
    let ahead_m = 100.0 * 15f64.to_radians().tan();
    let focal_length_px = 100.0 / GSD_M;
    for focal_length_px in [Some(focal_length_px), None] {
        let mut tracker = Tracker::new(TrackOptions {
            focal_length_px,
            ..TrackOptions::default()
        })
        .unwrap();
        for frame in 0..=40 {
            let time_s = 0.5 * f64::from(frame);
            let agl_m = if time_s < 8.0 { 100.0 } else { 55.0 };
            tracker.push(looking_ahead(time_s, 90.0, 15.0)).unwrap();
            tracker.push(height(time_s, agl_m)).unwrap();
            let seen = Input::Fix(PositionFix {
                // Along the axis of a tilted view a pixel covers more ground.
                gsd_m: GSD_M / 15f64.to_radians().cos().powf(1.5),
                ..seen_ahead(time_s, ahead_m)
            });
            tracker.push(seen).unwrap();
            let estimate = tracker.point_at(time_s).unwrap().estimate.unwrap();
            let error_m = error_m(&estimate, time_s);
            // Without a focal length no fix tells the height, so that what is said of its error holds for a few fixes.
            let is_known = focal_length_px.is_some() || time_s < 11.0;
            assert!(
                !is_known || error_m < estimate.radius95_m.max(4.0),
                "{focal_length_px:?}, {time_s} s: {error_m} m, {estimate:?}"
            );
        }
    }
}

#[test]
fn attitudes_of_one_time_turn_the_heading_no_further_than_the_last_of_them() {
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    for tick in 0..=130 {
        let time_s = 0.1 * f64::from(tick);
        for yaw_deg in [89.5, 90.5] {
            tracker.push(looking_ahead(time_s, yaw_deg, 0.0)).unwrap();
        }
        if tick % 5 == 0 && time_s < 8.0 {
            tracker.push(fix(time_s)).unwrap();
        }
    }
    // Five seconds after the last fix.
    let estimate = tracker.point_at(13.0).unwrap().estimate.unwrap();
    let heading_deg = estimate.heading_deg.unwrap();
    assert!((heading_deg - 90.0).abs() < 2.0, "{heading_deg}");
}

#[test]
fn a_yaw_that_is_reset_does_not_turn_the_tilt() {
    let ahead_m = 100.0 * 15f64.to_radians().tan();
    let mut tracker = Tracker::new(TrackOptions {
        focal_length_px: Some(100.0 / GSD_M),
        ..TrackOptions::default()
    })
    .unwrap();
    for frame in 0..=30 {
        let time_s = 0.5 * f64::from(frame);
        tracker
            .push(looking_ahead(
                time_s,
                if time_s < 8.0 { 90.0 } else { 210.0 },
                15.0,
            ))
            .unwrap();
        tracker.push(height(time_s, 100.0)).unwrap();
        tracker
            .push(Input::Fix(seen_ahead(time_s, ahead_m)))
            .unwrap();
        let estimate = tracker.point_at(time_s).unwrap().estimate.unwrap();
        let error_m = error_m(&estimate, time_s);
        assert!(error_m < 4.0, "{time_s} s: {error_m} m, {estimate:?}");
        let heading_deg = estimate.heading_deg.unwrap();
        assert!(
            (heading_deg - 90.0).abs() < 2.0,
            "{time_s} s: {heading_deg}"
        );
    }
}

/// Photos that are seconds apart with the attitude in their metadata: no attitude tells the turn between two, and no motion either.
#[test]
fn a_turn_that_nothing_told_does_not_displace_a_tilted_view() {
    let ahead_m = 100.0 * 20f64.to_radians().tan();
    for turned_deg in [30.0, 45.0, 60.0, 80.0, 120.0] {
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        for frame in 0..=12 {
            let time_s = 3.0 * f64::from(frame);
            let yaw_deg = if frame < 9 { 0.0 } else { turned_deg };
            tracker.push(looking_ahead(time_s, yaw_deg, 20.0)).unwrap();
            tracker.push(height(time_s, 100.0)).unwrap();
            let (sin, cos) = yaw_deg.to_radians().sin_cos();
            let seen = PositionFix {
                // It hovers.
                lonlat: destination_en_m(START, ahead_m * sin, ahead_m * cos),
                heading_deg: Some(yaw_deg),
                ..seen_ahead(time_s, 0.0)
            };
            tracker.push(Input::Fix(seen)).unwrap();
            let estimate = tracker.point_at(time_s).unwrap().estimate.unwrap();
            let place = LonLat::new(estimate.lon_deg, estimate.lat_deg);
            let error_m = distance_m(place, START);
            assert!(
                error_m < 3.0 && error_m < estimate.radius95_m,
                "{turned_deg} degrees, {time_s} s: {error_m} m, {estimate:?}"
            );
        }
    }
}

/// An attitude that holds for every other photo only: the camera's tilt is the same in all of them.
#[test]
fn a_tilt_that_is_known_now_and_then_does_not_average_away() {
    // The last one is two and a half times what is assumed of an unknown tilt, and does not change as that is assumed to do.
    for (tilt_deg, most) in [(10.0f64, 1.0), (15.0, 1.0), (20.0, 1.5)] {
        let ahead_m = 120.0 * tilt_deg.to_radians().tan();
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        for frame in 0..300 {
            let time_s = 0.7 * f64::from(frame);
            let attitude_s = time_s.floor();
            tracker
                .push(looking_ahead(attitude_s, 90.0, tilt_deg))
                .unwrap();
            tracker.push(height(attitude_s, 120.0)).unwrap();
            tracker.push(velocity(attitude_s, SPEED_M_S)).unwrap();
            tracker
                .push(Input::Fix(seen_ahead(time_s, ahead_m)))
                .unwrap();
            let estimate = tracker.point_at(time_s).unwrap().estimate.unwrap();
            let error_m = error_m(&estimate, time_s);
            assert!(
                error_m < most * estimate.radius95_m,
                "{tilt_deg} degrees, {time_s} s: {error_m} m, {estimate:?}"
            );
        }
    }
}

/// The camera looks ahead by the same angle all the time. Motion between two frames is that of the aircraft, or that of the image centre.
#[test]
fn motion_to_a_view_of_another_kind_does_not_contradict_the_fix_in_it() {
    let is_known: [fn(u32) -> bool; 4] = [
        |frame| frame >= 12,
        |frame| frame < 12,
        |frame| frame.is_multiple_of(2),
        |frame| frame % 3 != 2,
    ];
    for (case, is_known) in is_known.into_iter().enumerate() {
        for tilt_deg in [5.0f64, 10.0, 15.0] {
            let ahead_m = 100.0 * tilt_deg.to_radians().tan();
            let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
            for frame in 0..40 {
                // Further apart than an attitude counts.
                let time_s = f64::from(frame);
                tracker.push(height(time_s, 100.0)).unwrap();
                if is_known(frame) {
                    tracker.push(looking_ahead(time_s, 90.0, tilt_deg)).unwrap();
                }
                if frame > 0 {
                    let motion = RelativeMotion {
                        from_time_s: time_s - 1.0,
                        time_s,
                        forward_px: SPEED_M_S / GSD_M,
                        right_px: 0.0,
                        turn_deg: 0.0,
                        sigma_px: 0.5,
                        surface_sigma_px: Some(0.0),
                    };
                    tracker.push(Input::Motion(motion)).unwrap();
                }
                tracker
                    .push(Input::Fix(seen_ahead(time_s, ahead_m)))
                    .unwrap();
                let estimate = tracker.point_at(time_s).unwrap().estimate.unwrap();
                let error_m = error_m(&estimate, time_s);
                assert!(
                    estimate.is_at_fix() && error_m < estimate.radius95_m,
                    "case {case}, {tilt_deg} degrees, {time_s} s: {error_m} m, {estimate:?}"
                );
            }
        }
    }
}

/// Nothing reports the height any more, while the camera looks 15 degrees ahead.
#[test]
fn where_the_height_is_not_known_any_more_the_image_centre_is_another_point() {
    let ahead_m = 100.0 * 15f64.to_radians().tan();
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    for frame in 0..=40 {
        let time_s = f64::from(frame);
        tracker.push(looking_ahead(time_s, 90.0, 15.0)).unwrap();
        if frame <= 20 {
            tracker.push(height(time_s, 100.0)).unwrap();
        }
        tracker
            .push(Input::Fix(seen_ahead(time_s, ahead_m)))
            .unwrap();
        let estimate = tracker.point_at(time_s).unwrap().estimate.unwrap();
        assert!(estimate.is_at_fix(), "{time_s} s: the fix was rejected");
        let is_of_centre = estimate.position_of == PositionOf::ImageCentre;
        assert_eq!(is_of_centre, time_s > 20.0 + Height::HOLD_S, "{time_s} s");
        let ahead_m = if is_of_centre { ahead_m } else { 0.0 };
        let place = LonLat::new(estimate.lon_deg, estimate.lat_deg);
        let truth = destination_en_m(START, SPEED_M_S * time_s + ahead_m, 0.0);
        let error_m = distance_m(place, truth);
        assert!(
            error_m < estimate.radius95_m,
            "{time_s} s: {error_m} m, {estimate:?}"
        );
    }
}

/// A gimbal looks 65 degrees ahead of straight down, from the beginning or for ten seconds in between: 214 m ahead of the aircraft.
#[test]
fn a_view_far_ahead_gives_no_position_of_the_aircraft() {
    for far_from_s in [0.0, 10.0] {
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        let mut inputs = Vec::new();
        for frame in 0..=30 {
            let time_s = f64::from(frame);
            let is_far = (far_from_s..20.0).contains(&time_s);
            let tilt_deg: f64 = if is_far { 65.0 } else { 20.0 };
            let ahead_m = 100.0 * tilt_deg.to_radians().tan();
            let of_frame = [
                looking_ahead(time_s, 90.0, tilt_deg),
                height(time_s, 100.0),
                velocity(time_s, SPEED_M_S),
                Input::Fix(seen_ahead(time_s, ahead_m)),
            ];
            for input in of_frame {
                tracker.push(input).unwrap();
            }
            inputs.extend(of_frame);
            let estimate = tracker.point_at(time_s).and_then(|point| point.estimate);
            if let Some(estimate) = estimate {
                let error_m = error_m(&estimate, time_s);
                assert!(
                    error_m < estimate.radius95_m && estimate.is_at_fix() != is_far,
                    "far from {far_from_s} s, {time_s} s: {error_m} m, {estimate:?}"
                );
            }
            let has_begun = time_s < far_from_s || time_s >= 23.0;
            assert!(estimate.is_some() || !has_begun, "{time_s} s");
        }
        for point in smooth(&inputs, &TrackOptions::default()).unwrap() {
            let place = LonLat::new(point.lon_deg, point.lat_deg);
            let truth = destination_en_m(START, SPEED_M_S * point.time_s, 0.0);
            let error_m = distance_m(place, truth);
            assert!(error_m < 10.0, "smoothed: {error_m} m, {point:?}");
        }
    }
}

#[test]
fn a_climb_changes_the_ground_resolution() {
    let climbed = tracked_by_motion(|time_s| 100.0 + 5.0 * (time_s - 8.0).max(0.0));
    let (low_m, high_m) = climbed.search(16.0, 60.0).windows[0].gsd_m.unwrap();
    let middle_m = (low_m * high_m).sqrt();
    assert!((middle_m / GSD_M - 1.4).abs() < 0.05, "{middle_m}");
}

#[test]
fn a_start_is_of_the_first_frame_and_not_of_the_telemetry_before_it() {
    let options = TrackOptions {
        start: Some(Start {
            lonlat: START,
            radius95_m: 50.0,
        }),
        ..TrackOptions::default()
    };
    let first_s = 600.0;
    let mut stated_m = Vec::new();
    for (before_s, has_velocity) in [(0.0, false), (600.0, false), (600.0, true)] {
        let mut tracker = Tracker::new(options.clone()).unwrap();
        let ticks = (before_s * 5.0) as u32;
        for tick in 0..=ticks {
            let time_s = first_s - before_s + 0.2 * f64::from(tick);
            tracker.push(attitude(time_s)).unwrap();
            if has_velocity {
                tracker.push(velocity(time_s, 0.0)).unwrap();
            }
        }
        assert!(tracker.awaits_start());
        let search = tracker.search(first_s, 60.0);
        let window = search.windows[0];
        assert!(distance_m(window.centre, START) < 0.1);
        assert!(window.radius_m < 180.0, "{before_s} s: {window:?}");
        assert_eq!(window.heading_deg.map(|(yaw_deg, _)| yaw_deg), Some(90.0));
        tracker.push(Input::Miss(Miss { time_s: first_s })).unwrap();
        assert!(!tracker.awaits_start());
        let estimate = tracker.point_at(first_s).unwrap().estimate.unwrap();
        stated_m.push(estimate.radius95_m);
        let later = tracker.point_at(first_s + 5.0).unwrap().estimate.unwrap();
        assert!(
            later.radius95_m > estimate.radius95_m,
            "it grows from there on"
        );
    }
    for radius_m in stated_m {
        assert!((radius_m - 50.0).abs() < 0.5, "{radius_m}");
    }
}

/// Its clock is set, or what it was given turns out to be wrong.
#[test]
fn a_start_is_not_placed_again_where_the_filter_begins_again_in_flight() {
    let options = TrackOptions {
        start: Some(Start {
            lonlat: START,
            radius95_m: 20.0,
        }),
        ..TrackOptions::default()
    };
    // 6 s, and 60 m, after the start.
    let mut flown = Tracker::new(options.clone()).unwrap();
    for second in 0..=6 {
        flown.push(fix(f64::from(second))).unwrap();
    }
    flown.restart();
    assert!(!flown.awaits_start());
    assert!(flown.search(7.0, 60.0).windows.is_empty());
    for second in 7..12 {
        let time_s = f64::from(second);
        flown.push(fix(time_s)).unwrap();
        if let Some(estimate) = flown.point_at(time_s).unwrap().estimate {
            let error_m = error_m(&estimate, time_s);
            assert!(error_m < 4.0, "{time_s} s: {error_m} m, {estimate:?}");
        }
    }
    // A clock that is set on the ground does not move the aircraft.
    let mut waiting = Tracker::new(options).unwrap();
    waiting.push(attitude(0.0)).unwrap();
    waiting.restart();
    assert!(waiting.awaits_start());
}
