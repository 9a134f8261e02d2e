//! Options of `grim eval --track`, and the flights that they ask for.

use clap::Args;
use grimnet_eval::tracks::ground_cover::covered_legs;
use grimnet_eval::tracks::rendered::{CAMERA, RenderedPlan};
use grimnet_eval::tracks::town::Town;
use grimnet_track::Vehicle;
use grimnet_track::simulation::{Camera, FlightArea, FlightOptions};
use grimnet_world::WorldError;

use super::elsewhere::ELSEWHERE_FOLDERS;
use crate::values;

/// The longest flight, seconds: a longer evaluation has several.
const LONGEST_FLIGHT_S: f64 = 600.0;
/// The flight in which the aircraft is put elsewhere: its length and when, seconds.
const KIDNAPPED_S: [f64; 2] = [36.0, 20.0];
/// Part of the town that is flown over: a photo near the edge shows little of the map.
const FLOWN_SHARE: f64 = 0.72;
/// Mean time between legs over water and snow, seconds.
const LEGS_APART_S: f64 = 90.0;
/// Legs of short flights are not longer than this part of the flight.
const LONGEST_LEG_SHARE: f64 = 0.2;
/// The longest leg over water or snow, seconds.
const LONGEST_LEG_S: f64 = 120.0;

/// Options of `grim eval --track`.
#[derive(Debug, Args)]
pub struct TrackEvalOptions {
    /// Evaluate the track of flights: with --world flights that are rendered frame by frame and simulated ones, with FOLDER its
    /// photos in order of time, of which one to four in a row are hidden
    ///
    /// Three runs are compared: fixes only, motion only, and the filter. Writes track_summary.json, track_report.html and tables
    /// to the folder of results.
    #[arg(long, conflicts_with = ELSEWHERE_FOLDERS, help_heading = "Tracks")]
    track: bool,

    /// Minutes of flight that are rendered, in flights of at most ten
    ///
    /// Each flight is kept in DIR/flights when it is done. The same command goes on after the last of them, and one with more
    /// flights of the same length renders only the new ones.
    #[arg(
        long,
        value_name = "M",
        value_parser = values::minutes,
        allow_hyphen_values = true,
        default_value_t = 4.0,
        requires = "track",
        conflicts_with = "folder",
        help_heading = "Tracks"
    )]
    minutes: f64,

    /// Towns that the flights are spread over: those of SEED, SEED + 1 and so on
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=1000),
        default_value_t = 1,
        requires = "track",
        conflicts_with = "folder",
        help_heading = "Tracks"
    )]
    worlds: u32,

    /// Frames a second
    #[arg(
        long,
        value_name = "HZ",
        value_parser = values::frame_rate_hz,
        allow_hyphen_values = true,
        default_value_t = 2.0,
        requires = "track",
        conflicts_with = "folder",
        help_heading = "Tracks"
    )]
    frame_rate: f64,

    /// Flights of ten minutes that are simulated from the statistics of the rendered fixes, with aliases; 0 for none
    #[arg(
        long,
        value_name = "N",
        default_value_t = 60,
        requires = "track",
        conflicts_with = "folder",
        help_heading = "Tracks"
    )]
    pub(super) simulated_flights: u32,
}

impl TrackEvalOptions {
    /// Whether tracks are evaluated.
    pub fn is_asked(&self) -> bool {
        self.track
    }

    /// Number of flights, without that in which the aircraft is put elsewhere.
    fn flight_count(&self) -> u64 {
        (60.0 * self.minutes / LONGEST_FLIGHT_S).ceil().max(1.0) as u64
    }

    /// Seeds of the towns.
    pub(super) fn town_seeds(&self, seed: u64) -> Vec<u64> {
        let towns = u64::from(self.worlds).min(self.flight_count());
        (0..towns).map(|town| seed.wrapping_add(town)).collect()
    }

    /// The flights over the town `number` of [`Self::town_seeds`], whose first has `seed`: vehicles, cameras and delays take
    /// turns, and over the first town there is one more in which the aircraft is put elsewhere.
    pub(super) fn plans(&self, seed: u64, number: u64, area: FlightArea) -> Vec<RenderedPlan> {
        let towns = u64::from(self.worlds);
        let mut plans: Vec<RenderedPlan> = (0..self.flight_count())
            .filter(|index| index % towns == number)
            .map(|index| self.plan(seed, index, area))
            .collect();
        let [duration_s, put_elsewhere_s] = KIDNAPPED_S;
        let first = plans.first().filter(|_| number == 0).cloned();
        plans.extend(first.map(|first| RenderedPlan {
            name: "put elsewhere".to_owned(),
            flight: FlightOptions {
                seed: first.flight.seed ^ 0xe15e,
                duration_s,
                put_elsewhere_s: Some(put_elsewhere_s),
                ..first.flight
            },
            legs: Vec::new(),
        }));
        plans
    }

    fn plan(&self, seed: u64, index: u64, area: FlightArea) -> RenderedPlan {
        let (vehicle, vehicle_name) = if index.is_multiple_of(2) {
            (Vehicle::Multirotor, "multirotor")
        } else {
            (Vehicle::Plane, "plane")
        };
        let (camera, camera_name) = if (index / 2).is_multiple_of(2) {
            (Camera::Fixed, "fixed camera")
        } else {
            (Camera::Gimbal, "gimbal")
        };
        let latest_s = if index % 3 == 2 { 5.0 } else { 0.0 };
        let flight = FlightOptions {
            seed: seed.wrapping_mul(1000).wrapping_add(index),
            duration_s: 60.0 * self.minutes / self.flight_count() as f64,
            frame_rate_hz: self.frame_rate,
            vehicle,
            camera,
            latest_s,
            motion: true,
            focal_length_px: CAMERA.focal_px(),
            area: Some(area),
            ..FlightOptions::default()
        };
        let longest_s = (LONGEST_LEG_SHARE * flight.duration_s).clamp(10.0, LONGEST_LEG_S);
        RenderedPlan {
            name: format!(
                "flight {}: {vehicle_name}, {camera_name}, fixes up to {latest_s} s late",
                index + 1
            ),
            legs: covered_legs(flight.duration_s, longest_s, LEGS_APART_S, flight.seed),
            flight,
        }
    }
}

/// The part of a town that is flown over.
///
/// # Errors
/// The town is outside of its projection.
pub(super) fn flown_area(town: &Town) -> Result<FlightArea, WorldError> {
    let size_m = town.world.size_m();
    Ok(FlightArea {
        centre: town.lonlat([0.5 * size_m; 2])?,
        half_side_m: 0.5 * FLOWN_SHARE * size_m,
    })
}
