//! A simulated flight: truth, and what sensors and fixes report of it and when.

use grimnet_geo::{LonLat, destination_en_m};
use nalgebra::{Rotation2, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{
    delivered::Delivered,
    fixes::frames,
    options::FlightOptions,
    path::{Truth, fly, truth_at},
    telemetry::telemetry,
};
use crate::attitude::Attitude;

/// A simulated flight.
#[derive(Debug, Clone)]
pub struct Flight {
    /// What was simulated.
    pub options: FlightOptions,
    /// Inputs in order of arrival.
    pub deliveries: Vec<Delivered>,
    path: Vec<Truth>,
}

/// Where the aircraft truly is and how the frame that carries the camera truly leans.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruePose {
    /// The place below the aircraft.
    pub lonlat: LonLat,
    /// Metres above ground.
    pub height_agl_m: f64,
    /// True attitude.
    pub attitude: Attitude,
    /// Velocity over ground, metres per second east and north.
    pub velocity_en_m_s: [f64; 2],
}

impl Flight {
    /// Draws a flight.
    pub fn new(options: FlightOptions) -> Self {
        let (mut flight, mut rng) = Self::begun(options);
        let deliveries = frames(&flight.options, &flight.path, &flight.deliveries, &mut rng);
        flight.deliver(deliveries);
        flight
    }

    /// Draws the path and what the autopilot tells; what the frames tell is delivered by the caller.
    pub fn without_frames(options: FlightOptions) -> Self {
        Self::begun(options).0
    }

    fn begun(options: FlightOptions) -> (Self, ChaCha8Rng) {
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        let mut path = fly(&options, &mut rng);
        if let (Some(at_s), None) = (options.put_elsewhere_s, options.area) {
            let angle_rad = rng.random_range(0.0..std::f64::consts::TAU);
            let there_m =
                Rotation2::new(angle_rad) * Vector2::new(rng.random_range(500.0..1500.0), 0.0);
            for truth in path.iter_mut().filter(|truth| truth.time_s >= at_s) {
                truth.position_m += there_m;
            }
        }
        let deliveries = telemetry(&options, &path, &mut rng);
        let flight = Self {
            options,
            deliveries,
            path,
        };
        (flight, rng)
    }

    /// Adds inputs.
    pub fn deliver(&mut self, deliveries: impl IntoIterator<Item = Delivered>) {
        self.deliveries.extend(deliveries);
        self.deliveries
            .sort_by(|a, b| a.arrival_s.total_cmp(&b.arrival_s));
    }

    /// Where the aircraft is, in steps of 1/20 s.
    pub fn truth_at(&self, time_s: f64) -> LonLat {
        let truth = truth_at(&self.path, time_s);
        destination_en_m(
            self.options.origin(),
            truth.position_m.x,
            truth.position_m.y,
        )
    }

    /// The true pose, in steps of 1/20 s.
    pub fn pose_at(&self, time_s: f64) -> TruePose {
        let truth = truth_at(&self.path, time_s);
        TruePose {
            lonlat: self.truth_at(time_s),
            height_agl_m: truth.height_agl_m,
            attitude: Attitude {
                time_s: truth.time_s,
                yaw_deg: truth.yaw_deg,
                pitch_deg: truth.pitch_deg,
                roll_deg: truth.roll_deg,
            },
            velocity_en_m_s: truth.velocity_m_s.into(),
        }
    }

    /// Times at which a track is measured: five a second.
    pub fn instants_s(&self) -> impl Iterator<Item = f64> + use<> {
        let count = (self.options.duration_s * 5.0) as u32;
        (1..count).map(|index| f64::from(index) * 0.2)
    }
}
