//! The check of velocities over simulated flights: hours of right velocities with fixes of other places, gusts and banked turns.

use grimnet_geo::{LonLat, destination_en_m};
use grimnet_track::simulation::{Camera, Delivered, Flight, FlightOptions};
use grimnet_track::{Attitude, Input, PositionFix, TrackOptions, Tracker, Vehicle};

use super::displacement::PlacedFix;
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

/// Follows a simulated flight whose velocities are off by so much from [`SPOOFED_FROM_S`] on, metres per second to the north. Gives the
/// time at which they are inconsistent, seconds.
fn inconsistent_s(options: FlightOptions, spoofed_m_s: f64) -> Option<f64> {
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
    for Delivered { input, .. } in &flight.deliveries {
        let mut input = *input;
        match &mut input {
            Input::Attitude(attitude) => attitudes.push(*attitude),
            Input::Velocity(velocity) => {
                if velocity.time_s >= SPOOFED_FROM_S {
                    velocity.north_m_s += spoofed_m_s;
                }
                check.velocity(velocity);
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
                if check.warning().is_some() {
                    return Some(fix.time_s);
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
    }
    None
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
