//! Simulated hours: flights whose fixes are drawn from measured ones, with coherent aliases.

use std::sync::Arc;

use grimnet_track::simulation::{Camera, FixSample, Flight, FlightOptions, Gaps};
use grimnet_track::{OptionsError, TrackOptions, Vehicle};
use serde::Serialize;

use super::figures::ThreeFigures;
use super::frame_record::FrameRecord;
use super::three_runs::ThreeRuns;

/// Fewer measured fixes than this are no statistics.
const LEAST_SAMPLES: usize = 50;
/// Seconds of a simulated flight.
const DURATION_S: f64 = 600.0;
/// Beside one of so many flights there is another that is put elsewhere and counts for relocalisation alone.
const FLIGHTS_PER_KIDNAPPED: u64 = 5;

/// Statistics of measured fixes.
#[derive(Debug, Clone, Serialize)]
pub struct FixStatistics {
    /// Frames over town and country, without legs over water and snow.
    pub frames: usize,
    /// Share of them with a fix of the right place.
    pub fix_rate: f64,
    /// Share of fixes that are of another place.
    pub wrong_share: f64,
    /// Median error of the right fixes, metres, without the map's own.
    pub median_m: Option<f64>,
    /// Mean squared normalised error of the right fixes; 2 is expected.
    pub mean_nees: Option<f64>,
    /// The right fixes.
    #[serde(skip)]
    pub samples: Arc<[FixSample]>,
}

impl FixStatistics {
    /// Statistics of the frames of rendered flights.
    #[must_use]
    pub fn of<'a>(frames: impl Iterator<Item = &'a FrameRecord>) -> Self {
        let (mut count, mut wrong) = (0usize, 0usize);
        let (mut samples, mut errors_m, mut nees) = (Vec::new(), Vec::new(), Vec::new());
        for frame in frames.filter(|frame| frame.cover.is_none()) {
            count += 1;
            let Some(fix) = &frame.fix else { continue };
            if fix.is_wrong() {
                wrong += 1;
                continue;
            }
            samples.push(fix.without_relief());
            errors_m.push(fix.error_m);
            nees.extend(fix.nees());
        }
        let fixes = samples.len() + wrong;
        Self {
            frames: count,
            fix_rate: samples.len() as f64 / count.max(1) as f64,
            wrong_share: wrong as f64 / fixes.max(1) as f64,
            median_m: crate::metrics::statistics::percentile(&errors_m, 0.5),
            mean_nees: crate::metrics::statistics::mean(&nees),
            samples: samples.into(),
        }
    }

    /// Whether there are enough fixes to draw from.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        self.samples.len() >= LEAST_SAMPLES
    }
}

/// The options of simulated flight `index`: vehicles, cameras, frame rates, shares of aliases (10-40 %) and delays take turns;
/// fixes are drawn from `measured`, if that is given.
fn flight_options(index: u64, measured: Option<&FixStatistics>) -> FlightOptions {
    let base = FlightOptions::default();
    let vehicle = if index.is_multiple_of(2) {
        Vehicle::Multirotor
    } else {
        Vehicle::Plane
    };
    let camera = if (index / 2).is_multiple_of(2) {
        Camera::Fixed
    } else {
        Camera::Gimbal
    };
    FlightOptions {
        seed: index + 1,
        duration_s: DURATION_S,
        frame_rate_hz: [1.0, 2.0, 5.0][(index % 3) as usize],
        vehicle,
        camera,
        gaps: Some(Gaps {
            shortest_s: 30.0,
            longest_s: 30.0,
            apart_s: 120.0,
        }),
        alias_share: 0.1 * (1 + index / 4 % 4) as f64,
        latest_s: if (index / 3).is_multiple_of(2) {
            0.0
        } else {
            5.0
        },
        motion: true,
        fixes: measured.map(|measured| measured.samples.clone()),
        fix_rate: measured.map_or(base.fix_rate, |measured| measured.fix_rate),
        ..base
    }
}

/// Simulates `flights` flights of ten minutes. `measured` gives the fixes, if it has enough of them; `done` is called after each
/// flight.
///
/// # Errors
/// The filter's options are invalid.
pub fn simulate(
    flights: u64,
    measured: Option<&FixStatistics>,
    options: &TrackOptions,
    done: &mut dyn FnMut(),
) -> Result<ThreeFigures, OptionsError> {
    let measured = measured.filter(|measured| measured.is_enough());
    let mut runs = ThreeRuns::default();
    for index in 0..flights {
        let flight_options = flight_options(index, measured);
        let options = TrackOptions {
            vehicle: flight_options.vehicle,
            focal_length_px: Some(flight_options.focal_length_px),
            ..options.clone()
        };
        if index.is_multiple_of(FLIGHTS_PER_KIDNAPPED) {
            let kidnapped = FlightOptions {
                gaps: None,
                latest_s: 0.0,
                duration_s: 150.0,
                put_elsewhere_s: Some(100.0),
                ..flight_options.clone()
            };
            runs.add(&Flight::new(kidnapped), &options)?;
        }
        runs.add(&Flight::new(flight_options), &options)?;
        done();
    }
    Ok(runs.figures())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracks::frame_record::MeasuredFix;
    use crate::tracks::ground_cover::Cover;

    fn frame(index: usize, cover: Option<Cover>, error_m: Option<f64>) -> FrameRecord {
        let angle = index as f64;
        FrameRecord {
            time_s: angle,
            cover,
            tracked: true,
            fix: error_m.map(|error_m| MeasuredFix {
                sample: FixSample {
                    error_en_m: [error_m * angle.sin(), error_m * angle.cos()],
                    covariance_en_m2: [1.0, 0.0, 1.0],
                    confidence: 0.98,
                    heading_error_deg: 0.3,
                    gsd_ratio: 1.0,
                },
                error_m,
                relief_en_m: [0.0; 2],
            }),
            motion: None,
            time_ms: 20.0,
        }
    }

    #[test]
    fn statistics_leave_out_covered_ground_and_count_wrong_places() {
        let frames = [
            frame(0, None, Some(1.0)),
            frame(1, None, Some(2.0)),
            frame(2, None, None),
            frame(3, None, Some(300.0)),
            frame(4, Some(Cover::Water), None),
        ];
        let statistics = FixStatistics::of(frames.iter());
        assert_eq!((statistics.frames, statistics.samples.len()), (4, 2));
        assert_eq!(statistics.fix_rate, 0.5);
        assert!((statistics.wrong_share - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(statistics.median_m, Some(1.5));
        assert!(!statistics.is_enough());
    }

    #[test]
    fn simulated_flights_draw_from_the_measured_fixes() {
        let measured = |error_m: f64| {
            let frames: Vec<_> = (0..60).map(|i| frame(i, None, Some(error_m))).collect();
            FixStatistics::of(frames.iter())
        };
        let options = TrackOptions::default();
        let median = |error_m: f64| {
            let figures = simulate(2, Some(&measured(error_m)), &options, &mut || ()).unwrap();
            assert_eq!(figures.flights, 2);
            figures.fixes_only.track.median_m.unwrap()
        };
        assert!(median(6.0) > median(0.5) + 1.0);
    }
}
