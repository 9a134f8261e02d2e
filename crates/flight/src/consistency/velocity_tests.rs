//! The check of velocities over simulated flights: hours of right velocities with fixes of other places, gusts and banked turns.

use grimnet_geo::{LonLat, destination_en_m};
use grimnet_track::simulation::{Camera, Delivered, Flight, FlightOptions};
use grimnet_track::{Attitude, Input, PositionFix, TrackOptions, Tracker, Vehicle};

use super::compared_fix::PlacedFix;
use super::velocity::VelocityCheck;

/// From when on velocities are spoofed, seconds.
const SPOOFED_FROM_S: f64 = 200.0;

/// Where the aircraft is according to a fix.
fn placed(fix: &PositionFix, attitude: Option<Attitude>, tracker: &Tracker) -> PlacedFix {
    let height_agl_m = fix.gsd_m * tracker.options().focal_length_px.unwrap();
    let offset_en_m = attitude.and_then(|attitude| attitude.centre_offset_en_m(height_agl_m));
    let track = tracker
        .point_at(fix.time_s)
        .filter(|point| point.state.is_usable())
        .and_then(|point| point.estimate);
    PlacedFix {
        time_s: fix.time_s,
        place: offset_en_m.map_or(fix.lonlat, |[east_m, north_m]| {
            destination_en_m(fix.lonlat, -east_m, -north_m)
        }),
        is_of_aircraft: offset_en_m.is_some(),
        track: track.map(|track| LonLat::new(track.lon_deg, track.lat_deg)),
    }
}

/// Follows a simulated flight whose velocities to the north are off by `spoofed_m_s` of the time, metres per second. Gives the times at
/// which they are left out and used again in turns, the first `most` of them, seconds.
fn changes_s(options: FlightOptions, spoofed_m_s: impl Fn(f64) -> f64, most: usize) -> Vec<f64> {
    let flight = Flight::new(options.clone());
    let mut tracker = Tracker::new(TrackOptions {
        vehicle: options.vehicle,
        focal_length_px: Some(options.focal_length_px),
        ..TrackOptions::default()
    })
    .unwrap();
    let mut check = VelocityCheck::default();
    let mut attitudes: Vec<Attitude> = Vec::new();
    let mut gsd_m = None;
    let mut changes_s = Vec::new();
    for Delivered { input, .. } in &flight.deliveries {
        let mut input = *input;
        let was_left_out = check.warning().is_some();
        match &mut input {
            Input::Attitude(attitude) => attitudes.push(*attitude),
            Input::Velocity(velocity) => {
                velocity.north_m_s += spoofed_m_s(velocity.time_s);
                check.velocity(velocity);
                if was_left_out {
                    continue;
                }
            }
            Input::Motion(motion) => {
                if let Some(gsd_m) = gsd_m {
                    check.motion(motion, gsd_m, true);
                }
            }
            Input::Fix(fix) => {
                gsd_m = Some(fix.gsd_m);
                let before = attitudes.partition_point(|attitude| attitude.time_s <= fix.time_s);
                let attitude = before.checked_sub(1).map(|last| attitudes[last]);
                check.fix(placed(fix, attitude, &tracker), true);
                if check.warning().is_some() && !was_left_out {
                    tracker.restart();
                }
            }
            _ => {}
        }
        let _ = tracker.push(input);
        if let Input::Fix(fix) = input {
            let point = tracker.point_at(fix.time_s);
            let point = point.filter(|point| point.state.is_usable());
            let age_s = point.and_then(|point| point.estimate?.age_of_last_fix_s);
            if age_s == Some(0.0) {
                check.accepted();
            }
        }
        if check.warning().is_some() != was_left_out {
            changes_s.push(input.time_s());
            if changes_s.len() == most {
                break;
            }
        }
    }
    changes_s
}

/// When velocities are left out that are off by so much from [`SPOOFED_FROM_S`] on, metres per second.
fn inconsistent_s(options: FlightOptions, spoofed_m_s: f64) -> Option<f64> {
    let from_s = |time_s: f64| {
        if time_s >= SPOOFED_FROM_S {
            spoofed_m_s
        } else {
            0.0
        }
    };
    changes_s(options, from_s, 1).first().copied()
}

/// Flights whose fixes are of other places now and then.
fn usual() -> Vec<FlightOptions> {
    let base = FlightOptions {
        duration_s: 400.0,
        ..FlightOptions::default()
    };
    vec![
        base.clone(),
        FlightOptions {
            camera: Camera::Gimbal,
            latest_s: 5.0,
            ..base.clone()
        },
        FlightOptions {
            put_elsewhere_s: Some(120.0),
            ..base
        },
    ]
}

/// Flights of which every fifth fix or more is of another place that repeats, and a plane that banks.
fn hard() -> Vec<FlightOptions> {
    let base = FlightOptions {
        duration_s: 400.0,
        alias_share: 0.2,
        ..FlightOptions::default()
    };
    vec![
        FlightOptions {
            frame_rate_hz: 1.0,
            alias_share: 0.4,
            motion: true,
            ..base.clone()
        },
        FlightOptions {
            frame_rate_hz: 5.0,
            ..base.clone()
        },
        FlightOptions {
            vehicle: Vehicle::Plane,
            motion: true,
            ..base
        },
    ]
}

/// Eight flights of each kind, with and without attitude: how many of them are found to have inconsistent velocities.
fn inconsistent(kinds: Vec<FlightOptions>) -> usize {
    let seeds = |base: FlightOptions| {
        (1..=16).map(move |number| FlightOptions {
            seed: number / 2 + 1,
            attitude: number % 2 == 0,
            ..base.clone()
        })
    };
    kinds
        .into_iter()
        .flat_map(seeds)
        .filter(|options| inconsistent_s(options.clone(), 0.0).is_some())
        .count()
}

#[test]
fn right_velocities_are_consistent() {
    assert_eq!(inconsistent(usual()), 0);
    // Places that look alike repeat there by the dozen, and no heading tells them apart.
    let hard = inconsistent(hard());
    assert!(hard <= 10, "{hard} of 48 flights");
}

#[test]
fn velocities_that_are_off_by_five_metres_a_second_are_noticed_within_seconds() {
    for (kind, base) in [usual().swap_remove(0)]
        .into_iter()
        .chain(hard())
        .enumerate()
    {
        for seed in 1..=8 {
            let options = FlightOptions {
                seed,
                ..base.clone()
            };
            let after_s = inconsistent_s(options, 5.0).map(|at_s| at_s - SPOOFED_FROM_S);
            assert!(
                after_s.is_some_and(|after_s| after_s < 30.0),
                "{kind}, seed {seed}: {after_s:?}"
            );
        }
    }
}

#[test]
fn without_attitude_and_at_one_photo_in_seconds_they_are_noticed_as_well() {
    for (attitude, frame_rate_hz, most_s) in [
        (true, 0.25, 60.0),
        (false, 0.25, 120.0),
        (false, 0.5, 120.0),
        (false, 2.0, 120.0),
    ] {
        for base in usual() {
            for seed in 1..=4 {
                let options = FlightOptions {
                    seed,
                    attitude,
                    frame_rate_hz,
                    ..base.clone()
                };
                let after_s =
                    inconsistent_s(options.clone(), 11.0).map(|at_s| at_s - SPOOFED_FROM_S);
                assert!(
                    after_s.is_some_and(|after_s| (0.0..most_s).contains(&after_s)),
                    "{options:?}: {after_s:?}"
                );
            }
        }
    }
}

/// From when on velocities of [`wrong_for_a_while_m_s`] are right again, seconds.
const RIGHT_FROM_S: f64 = SPOOFED_FROM_S + 60.0;

fn wrong_for_a_while_m_s(time_s: f64) -> f64 {
    if (SPOOFED_FROM_S..RIGHT_FROM_S).contains(&time_s) {
        6.0
    } else {
        0.0
    }
}

#[test]
fn velocities_that_were_wrong_for_a_while_are_used_again() {
    for camera in [Camera::Fixed, Camera::Gimbal] {
        for seed in 1..=4 {
            let options = FlightOptions {
                seed,
                camera,
                duration_s: 600.0,
                ..FlightOptions::default()
            };
            let changes_s = changes_s(options, wrong_for_a_while_m_s, usize::MAX);
            let [left_out_s, again_s] = changes_s[..] else {
                panic!("{camera:?}, {seed}: {changes_s:?}");
            };
            assert!((SPOOFED_FROM_S..RIGHT_FROM_S).contains(&left_out_s));
            // A minute of agreement, and the time until the aircraft has turned.
            let after_s = again_s - RIGHT_FROM_S;
            assert!(
                (60.0..240.0).contains(&after_s),
                "{camera:?}, {seed}: {after_s}"
            );
        }
    }
}

#[test]
fn velocities_that_stay_wrong_stay_left_out() {
    let constant_m_s = |_: f64| 5.0;
    let slow_m_s = |_: f64| 2.0;
    let swinging_m_s = |since_s: f64| 6.0 * (since_s / 20.0).sin();
    let kinds: [&dyn Fn(f64) -> f64; 3] = [&constant_m_s, &slow_m_s, &swinging_m_s];
    for base in [usual().swap_remove(0)].into_iter().chain(hard()) {
        for (spoofed_m_s, attitude) in kinds.iter().flat_map(|kind| [(kind, true), (kind, false)]) {
            let options = FlightOptions {
                attitude,
                duration_s: 700.0,
                ..base.clone()
            };
            let since_m_s = |time_s: f64| {
                let since_s = time_s - SPOOFED_FROM_S;
                if since_s >= 0.0 {
                    spoofed_m_s(since_s)
                } else {
                    0.0
                }
            };
            let changes_s = changes_s(options, since_m_s, 2);
            assert!(changes_s.len() < 2, "{attitude}, {base:?}: {changes_s:?}");
        }
    }
}

#[test]
fn a_single_impossible_velocity_is_no_inconsistency() {
    let single_m_s = |time_s: f64| {
        if (time_s - SPOOFED_FROM_S).abs() < 0.05 {
            100.0
        } else {
            0.0
        }
    };
    for base in [usual().swap_remove(0)].into_iter().chain(hard()) {
        for seed in 1..=4 {
            let options = FlightOptions {
                seed,
                ..base.clone()
            };
            let left_out_s = |spoofed_m_s: &dyn Fn(f64) -> f64| -> Vec<f64> {
                let changes_s = changes_s(options.clone(), spoofed_m_s, usize::MAX);
                changes_s.into_iter().step_by(2).collect()
            };
            let (single_s, none_s) = (left_out_s(&single_m_s), left_out_s(&|_| 0.0));
            assert_eq!(single_s, none_s, "{options:?}");
        }
    }
}
