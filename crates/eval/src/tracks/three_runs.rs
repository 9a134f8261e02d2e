//! The runs that are compared, over one or more flights.

use grimnet_track::measure::{Measure, time_to_locate_s};
use grimnet_track::simulation::{Flight, Runs};
use grimnet_track::{Estimate, GATE_99_9_PERCENT, Input, OptionsError, TrackOptions, Tracker};

use super::figures::{Relocalised, RunFigures, ThreeFigures};

/// One run of all flights.
#[derive(Debug, Clone, Default)]
struct Gathered {
    measure: Measure,
    first_fix_s: Vec<f64>,
    relocalise: Vec<Relocalised>,
    /// Flights in which it did not find itself after it was put elsewhere.
    not_relocalised: usize,
    nis: Vec<f64>,
}

/// Gathers flights.
#[derive(Debug, Clone, Default)]
pub struct ThreeRuns {
    fixes_only: Gathered,
    motion_only: Gathered,
    filter: Gathered,
    motion_only_without_velocity: Gathered,
    filter_without_velocity: Gathered,
    flights: usize,
    seconds: f64,
}

/// Instants of one flight: the three runs, with and without the autopilot's velocity.
#[derive(Debug, Clone)]
pub struct FlightRuns {
    /// With the autopilot's velocity.
    pub with_velocity: Runs,
    /// With motion between frames in its place.
    pub without_velocity: Runs,
}

impl FlightRuns {
    /// Runs a flight.
    ///
    /// # Errors
    /// The filter's options are invalid.
    pub fn new(flight: &Flight, options: &TrackOptions) -> Result<Self, OptionsError> {
        Ok(Self {
            with_velocity: Runs::new(flight, options)?,
            without_velocity: Runs::new(&without_velocity(flight), options)?,
        })
    }
}

impl ThreeRuns {
    /// Adds a flight. One in which the aircraft was put elsewhere counts for the time to relocalise alone: until then the track
    /// is wrong, and rightly so.
    ///
    /// # Errors
    /// The filter's options are invalid.
    pub fn add(&mut self, flight: &Flight, options: &TrackOptions) -> Result<(), OptionsError> {
        let runs = FlightRuns::new(flight, options)?;
        self.add_runs(flight, &runs, options)
    }

    /// Adds a flight whose runs are made already.
    ///
    /// # Errors
    /// The filter's options are invalid.
    pub fn add_runs(
        &mut self,
        flight: &Flight,
        runs: &FlightRuns,
        options: &TrackOptions,
    ) -> Result<(), OptionsError> {
        let instants = [
            (&mut self.fixes_only, &runs.with_velocity.fixes_only),
            (&mut self.motion_only, &runs.with_velocity.motion_only),
            (&mut self.filter, &runs.with_velocity.filter),
            (
                &mut self.motion_only_without_velocity,
                &runs.without_velocity.motion_only,
            ),
            (
                &mut self.filter_without_velocity,
                &runs.without_velocity.filter,
            ),
        ];
        for (gathered, instants) in instants {
            if let Some(at_s) = flight.options.put_elsewhere_s {
                match time_to_locate_s(instants, at_s) {
                    Some(seconds) => gathered.relocalise.push(Relocalised {
                        seconds,
                        frames: seconds * flight.options.frame_rate_hz,
                    }),
                    None => gathered.not_relocalised += 1,
                }
                continue;
            }
            gathered.measure.add_flight(instants);
            let first_fix_s = time_to_locate_s(instants, 0.0).unwrap_or(f64::INFINITY);
            gathered.first_fix_s.push(first_fix_s);
        }
        if flight.options.put_elsewhere_s.is_none() {
            self.flights += 1;
            self.seconds += flight.options.duration_s;
            self.filter.nis.extend(innovations(flight, options)?);
        }
        Ok(())
    }

    /// Flights that were added, without those in which the aircraft was put elsewhere.
    #[must_use]
    pub fn flights(&self) -> usize {
        self.flights
    }

    /// The figures.
    #[must_use]
    pub fn figures(&self) -> ThreeFigures {
        ThreeFigures {
            flights: self.flights,
            hours: self.seconds / 3600.0,
            fixes_only: self.fixes_only.figures(),
            motion_only: self.motion_only.figures(),
            filter: self.filter.figures(),
            motion_only_without_velocity: self.motion_only_without_velocity.figures(),
            filter_without_velocity: self.filter_without_velocity.figures(),
        }
    }
}

impl Gathered {
    fn figures(&self) -> RunFigures {
        RunFigures::new(
            self.measure.summary(),
            &self.first_fix_s,
            &self.relocalise,
            self.not_relocalised,
            &self.nis,
        )
    }
}

/// The same flight without the autopilot's velocity.
fn without_velocity(flight: &Flight) -> Flight {
    let mut without = flight.clone();
    without
        .deliveries
        .retain(|delivered| !matches!(delivered.input, Input::Velocity(_)));
    without.options.velocity = false;
    without
}

/// Normalised innovations squared of the fixes that the leading hypothesis accepted, in order of time.
fn innovations(flight: &Flight, options: &TrackOptions) -> Result<Vec<f64>, OptionsError> {
    let mut inputs: Vec<Input> = flight.deliveries.iter().map(|d| d.input).collect();
    inputs.sort_by(|a, b| a.time_s().total_cmp(&b.time_s()));
    let mut tracker = Tracker::new(options.clone())?;
    let mut nis = Vec::new();
    for input in inputs {
        // What is refused is counted by the tracker.
        let _ = tracker.push(input);
        let Input::Fix(fix) = input else { continue };
        let estimate = tracker
            .point_at(fix.time_s)
            .and_then(|point| point.state.is_usable().then_some(point.estimate).flatten());
        nis.extend(
            estimate
                .filter(Estimate::is_at_fix)
                .map(|estimate| estimate.test_ratio * GATE_99_9_PERCENT),
        );
    }
    Ok(nis)
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_track::simulation::FlightOptions;

    #[test]
    fn put_elsewhere_counts_for_relocalisation_alone() {
        let options = TrackOptions::default();
        let flight = |put_elsewhere_s| {
            Flight::new(FlightOptions {
                duration_s: 60.0,
                put_elsewhere_s,
                alias_share: 0.0,
                motion: true,
                ..FlightOptions::default()
            })
        };
        let mut runs = ThreeRuns::default();
        runs.add(&flight(None), &options).unwrap();
        runs.add(&flight(Some(30.0)), &options).unwrap();
        let figures = runs.figures();
        assert_eq!((figures.flights, runs.flights()), (1, 1));
        assert_eq!(figures.filter.track.instants, 299);
        assert!(figures.filter.relocalise_s.unwrap() < 8.0, "{figures:?}");
        let frames = figures.filter.relocalise_s.map(|seconds| 2.0 * seconds);
        assert_eq!(figures.filter.relocalise_frames, frames);
        assert!(figures.filter.first_fix_s.unwrap() < 8.0, "{figures:?}");
        // Adding up velocity from the true start never notices.
        assert_eq!(figures.motion_only.relocalise_s, None);
        assert_eq!(figures.motion_only.not_relocalised, 1);
        let nis = figures.filter.nis.unwrap();
        assert!((1.0..3.0).contains(&nis.mean), "{nis:?}");
        assert!(figures.filter_without_velocity.track.median_m.unwrap() < 6.0);
    }

    #[test]
    fn a_flight_that_never_found_itself_counts_for_the_time_to_the_first_fix() {
        let options = TrackOptions::default();
        let flight = |fix_rate| {
            Flight::new(FlightOptions {
                duration_s: 20.0,
                fix_rate,
                alias_share: 0.0,
                ..FlightOptions::default()
            })
        };
        let mut runs = ThreeRuns::default();
        runs.add(&flight(1.0), &options).unwrap();
        assert!(runs.figures().fixes_only.first_fix_s.is_some());
        runs.add(&flight(0.0), &options).unwrap();
        assert_eq!(runs.figures().fixes_only.first_fix_s, None);
    }
}
