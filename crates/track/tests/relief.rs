//! Roofs under a plane that banks.

#![cfg(feature = "simulation")]
#![allow(clippy::unwrap_used)]

use grimnet_track::measure::Measure;
use grimnet_track::simulation::{FixSample, Flight, FlightOptions, run_filter};
use grimnet_track::{TrackOptions, Vehicle};

#[test]
fn roofs_that_a_tilted_view_meets_before_the_ground_are_where_the_ground_resolution_says() {
    // Roofs 18 m high under half of the photos, and a plane that banks.
    let fix = |gsd_ratio| FixSample {
        error_en_m: [0.0, 0.0],
        covariance_en_m2: [0.25, 0.0, 0.25],
        confidence: 0.99,
        heading_error_deg: 0.0,
        gsd_ratio,
    };
    let options = FlightOptions {
        vehicle: Vehicle::Plane,
        alias_share: 0.0,
        map_error_m: 0.1,
        boresight_deg: 0.1,
        attitude_sigma_deg: 0.05,
        fixes: Some([fix(1.0), fix(0.85)].into()),
        ..FlightOptions::default()
    };
    let measured = |focal_length_px| {
        let track = TrackOptions {
            vehicle: Vehicle::Plane,
            focal_length_px,
            ..TrackOptions::default()
        };
        let mut measure = Measure::default();
        for seed in 1..=5 {
            let flight = Flight::new(FlightOptions {
                seed,
                ..options.clone()
            });
            measure.add_flight(&run_filter(&flight, &track).unwrap());
        }
        measure.summary()
    };
    let with = measured(Some(options.focal_length_px));
    assert!(with.p99_m.unwrap() < 2.0, "{with:?}");
    assert!(with.answered > 0.98, "{with:?}");
    // The control: without a focal length the ground resolution tells no distance.
    let without = measured(None);
    assert!(
        without.p99_m.unwrap() > 1.5 * with.p99_m.unwrap(),
        "{without:?}"
    );
}
