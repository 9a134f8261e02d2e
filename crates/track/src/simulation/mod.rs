//! Simulated flights: what the filter would be given, and the truth.
//!
//! The errors that are drawn are those that the filter's options describe (the map's offset, boresight, attitude, velocity),
//! but also what they do not describe: banked turns, gusts, fixes of other places that repeat from frame to frame, late and
//! swapped fixes, and being put elsewhere.

mod camera;
mod delivered;
mod errors;
mod fixes;
mod flight;
mod options;
mod path;
mod runs;
mod telemetry;

pub use camera::Camera;
pub use delivered::Delivered;
pub use errors::Confidence;
pub use flight::{Flight, TruePose};
pub use options::{FixSample, FlightArea, FlightOptions, Gaps};
pub use runs::{Runs, fixes_only, motion_only, run_filter};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        measure::{Measure, TrackSummary, time_to_locate_s},
        options::{TrackOptions, Vehicle},
    };

    const GAPS: Option<Gaps> = Some(Gaps {
        shortest_s: 30.0,
        longest_s: 30.0,
        apart_s: 120.0,
    });

    /// Figures of the three runs over some flights.
    fn measured(flights: u64, base: &FlightOptions) -> [TrackSummary; 3] {
        let track = TrackOptions {
            vehicle: base.vehicle,
            ..TrackOptions::default()
        };
        let mut measures = [Measure::default(), Measure::default(), Measure::default()];
        for seed in 1..=flights {
            let runs = Runs::new(
                &Flight::new(FlightOptions {
                    seed,
                    ..base.clone()
                }),
                &track,
            )
            .unwrap();
            measures[0].add_flight(&runs.fixes_only);
            measures[1].add_flight(&runs.motion_only);
            measures[2].add_flight(&runs.filter);
        }
        measures.map(|measure| measure.summary())
    }

    #[test]
    fn gaps_of_half_a_minute_are_bridged_with_the_autopilots_velocity() {
        for vehicle in [Vehicle::Multirotor, Vehicle::Plane] {
            let [fixes, motion, filter] = measured(
                30,
                &FlightOptions {
                    vehicle,
                    gaps: GAPS,
                    alias_share: 0.2,
                    ..FlightOptions::default()
                },
            );
            assert!(filter.median_m.unwrap() <= 3.0, "{filter:?}");
            assert!(filter.p99_m.unwrap() <= 12.0, "{filter:?}");
            assert!(filter.availability_25m >= 0.985, "{filter:?}");
            assert_eq!(filter.confidently_wrong, 0, "{filter:?}");
            let held = filter.ellipse95_holds.unwrap();
            assert!((0.92..=0.98).contains(&held), "{filter:?}");
            // Neither input does it alone.
            assert!(
                fixes.availability_25m < 0.9 && fixes.confidently_wrong > 0,
                "{fixes:?}"
            );
            assert!(motion.median_m.unwrap() > 10.0, "{motion:?}");
        }
    }

    #[test]
    fn the_ellipses_hold_without_velocity_and_with_motion() {
        for motion in [false, true] {
            let base = FlightOptions {
                velocity: false,
                motion,
                gaps: GAPS,
                ..FlightOptions::default()
            };
            let [_, _, filter] = measured(20, &base);
            assert!(filter.ellipse95_holds.unwrap() >= 0.92, "{filter:?}");
            assert!(filter.median_m.unwrap() < 5.0, "{filter:?}");
        }
    }

    #[test]
    fn the_attitudes_error_does_not_add_up_over_motions_and_says_nothing_of_the_boresight() {
        for frame_rate_hz in [1.0, 5.0] {
            let base = FlightOptions {
                velocity: false,
                motion: true,
                alias_share: 0.0,
                frame_rate_hz,
                gaps: GAPS,
                ..FlightOptions::default()
            };
            let [_, _, filter] = measured(20, &base);
            let held = filter.ellipse95_holds.unwrap();
            assert!((0.92..=0.985).contains(&held), "{filter:?}");
            // 0.3 degrees a frame at 5 Hz are 0.6 m; the sum of independent ones over a gap of 30 s would be 8 m.
            assert!(filter.p90_m.unwrap() < 12.0, "{filter:?}");
        }
    }

    #[test]
    fn waves_that_seem_to_be_motion_are_not_believed() {
        let (mut measure, mut believing) = (Measure::default(), Measure::default());
        for seed in 1..=20 {
            let options = FlightOptions {
                seed,
                velocity: false,
                motion: true,
                frame_rate_hz: 1.0,
                gaps: Some(Gaps {
                    shortest_s: 10.0,
                    longest_s: 120.0,
                    apart_s: 120.0,
                }),
                ..FlightOptions::default()
            };
            let mut flight = Flight::new(options);
            let track = TrackOptions::default();
            measure.add_flight(&run_filter(&flight, &track).unwrap());
            // The control: all that moves is taken for ground.
            for delivered in &mut flight.deliveries {
                if let crate::Input::Motion(motion) = &mut delivered.input {
                    motion.surface_sigma_px = Some(0.0);
                }
            }
            believing.add_flight(&run_filter(&flight, &track).unwrap());
        }
        let (measured, believing) = (measure.summary(), believing.summary());
        assert_eq!(measured.confidently_wrong, 0, "{measured:?}");
        let held = measured.ellipse95_holds.unwrap();
        assert!((0.93..=0.99).contains(&held), "{measured:?}");
        assert!(measured.p99_m.unwrap() < 200.0, "{measured:?}");
        assert!(
            believing.confidently_wrong > 100 && believing.ellipse95_holds.unwrap() < 0.9,
            "{believing:?}"
        );
    }

    #[test]
    fn photos_twenty_seconds_apart_are_believed_for_most_of_the_time_between_them() {
        let sparse = |alias_share: f64| {
            let [_, _, filter] = measured(
                40,
                &FlightOptions {
                    frame_rate_hz: 0.05,
                    duration_s: 1800.0,
                    velocity: false,
                    attitude: false,
                    alias_share,
                    ..FlightOptions::default()
                },
            );
            filter
        };
        let clean = sparse(0.0);
        assert!(clean.answered > 0.7, "{clean:?}");
        assert_eq!(clean.confidently_wrong, 0, "{clean:?}");
        // One fix in ten is of another place, for three photos in the mean.
        let aliased = sparse(0.1);
        assert!(aliased.answered > 0.55, "{aliased:?}");
        let answers = aliased.answered * aliased.instants as f64;
        assert!(
            (aliased.confidently_wrong as f64) < 0.004 * answers,
            "{aliased:?}"
        );
    }

    #[test]
    fn without_attitude_the_covariance_has_the_tilt_in_it() {
        let [_, _, filter] = measured(
            20,
            &FlightOptions {
                attitude: false,
                ..FlightOptions::default()
            },
        );
        assert!(filter.ellipse95_holds.unwrap() >= 0.95, "{filter:?}");
        assert!(
            filter.median_m.unwrap() > 5.0 && filter.availability_5m == 0.0,
            "{filter:?}"
        );
    }

    #[test]
    fn late_and_swapped_fixes_cost_little() {
        let base = FlightOptions {
            gaps: GAPS,
            latest_s: 5.0,
            ..FlightOptions::default()
        };
        let [_, _, filter] = measured(10, &base);
        assert!(
            filter.median_m.unwrap() <= 3.0 && filter.p99_m.unwrap() <= 14.0,
            "{filter:?}"
        );
        assert_eq!(filter.confidently_wrong, 0);
    }

    #[test]
    fn put_elsewhere_it_is_found_again_within_ten_frames() {
        let mut frames: Vec<f64> = (1..=20)
            .map(|seed| {
                let options = FlightOptions {
                    seed,
                    put_elsewhere_s: Some(100.0),
                    duration_s: 150.0,
                    alias_share: 0.0,
                    ..FlightOptions::default()
                };
                let flight = Flight::new(options);
                let track = run_filter(&flight, &TrackOptions::default()).unwrap();
                time_to_locate_s(&track, 100.0).unwrap() * flight.options.frame_rate_hz
            })
            .collect();
        frames.sort_by(f64::total_cmp);
        assert!(frames[frames.len() / 2] <= 10.0, "{frames:?}");
        assert!(frames[frames.len() - 1] <= 14.0, "{frames:?}");
    }

    /// Figures of the smoothed track over some flights, and of the filter's.
    fn smoothed(flights: u64, base: &FlightOptions) -> [TrackSummary; 2] {
        let (mut filtered, mut smoothed) = (Measure::default(), Measure::default());
        let track = TrackOptions::default();
        for seed in 1..=flights {
            let flight = Flight::new(FlightOptions {
                seed,
                ..base.clone()
            });
            let inputs: Vec<crate::Input> = flight.deliveries.iter().map(|d| d.input).collect();
            let instants: Vec<_> = crate::smooth(&inputs, &track)
                .unwrap()
                .iter()
                .filter(|point| point.time_s > 0.0)
                .map(|point| {
                    crate::measure::Instant::of_smoothed(point, flight.truth_at(point.time_s))
                })
                .collect();
            smoothed.add_flight(&instants);
            filtered.add_flight(&run_filter(&flight, &track).unwrap());
        }
        [smoothed, filtered].map(|measure| measure.summary())
    }

    #[test]
    fn smoothing_bridges_gaps_from_both_sides() {
        let [smoothed, filtered] = smoothed(
            20,
            &FlightOptions {
                gaps: GAPS,
                alias_share: 0.2,
                ..FlightOptions::default()
            },
        );
        assert!(
            smoothed.p99_m.unwrap() < 0.7 * filtered.p99_m.unwrap(),
            "{smoothed:?} {filtered:?}"
        );
        assert!(
            smoothed.median_m.unwrap() <= filtered.median_m.unwrap(),
            "{smoothed:?} {filtered:?}"
        );
        assert!(
            smoothed.availability_25m > 0.999 && smoothed.confidently_wrong == 0,
            "{smoothed:?}"
        );
        // What is left is mostly the map's offset, one draw a flight: the standard deviation of the share is 5 %.
        let held = smoothed.ellipse95_holds.unwrap();
        assert!(held >= 0.93, "{smoothed:?}");
    }

    #[test]
    fn smoothing_knows_how_little_it_learns_of_an_unknown_tilt() {
        let [smoothed, _] = smoothed(
            20,
            &FlightOptions {
                attitude: false,
                ..FlightOptions::default()
            },
        );
        let held = smoothed.ellipse95_holds.unwrap();
        assert!(held >= 0.93, "{smoothed:?}");
    }
}
