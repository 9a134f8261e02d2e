//! What is simulated.

use std::sync::Arc;

use grimnet_geo::LonLat;
use serde::{Deserialize, Serialize};

use super::{camera::Camera, errors::Confidence};
use crate::options::Vehicle;

/// A square in which the aircraft stays, but for the room that a turn needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightArea {
    /// Its centre, where the flight begins.
    pub centre: LonLat,
    /// Half its side, metres.
    pub half_side_m: f64,
}

/// A right fix: what is drawn again for other frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FixSample {
    /// Error of the image centre without the map's own and without what the height of the matched surface moves, metres east and
    /// north.
    pub error_en_m: [f64; 2],
    /// Stated 1-sigma covariance without the map's error, square metres: east-east, east-north, north-north.
    pub covariance_en_m2: [f64; 3],
    /// Stated confidence.
    pub confidence: f64,
    /// Error of the heading, degrees.
    pub heading_error_deg: f64,
    /// Measured over true ground resolution: below 1 where roofs were matched.
    pub gsd_ratio: f64,
}

/// Legs where no frame gives a fix: over water, whose waves move, and over ground that the map shows otherwise, in turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaps {
    /// Shortest leg, seconds.
    pub shortest_s: f64,
    /// Longest leg, seconds.
    pub longest_s: f64,
    /// Mean time between legs, seconds.
    pub apart_s: f64,
}

/// What is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightOptions {
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Seconds.
    pub duration_s: f64,
    /// Frames a second.
    pub frame_rate_hz: f64,
    /// The vehicle.
    pub vehicle: Vehicle,
    /// How the camera is carried.
    pub camera: Camera,
    /// Metres above ground.
    pub height_agl_m: f64,
    /// Focal length of the photos, pixels.
    pub focal_length_px: f64,
    /// Where the aircraft stays. `None`: it flies where it likes, from a place of this module's choice.
    pub area: Option<FlightArea>,
    /// Share of frames outside of gaps that give a fix.
    pub fix_rate: f64,
    /// Right fixes to draw from, for instance measured ones. `None`: a normal error of 0.5 to 2 m, with its true covariance.
    pub fixes: Option<Arc<[FixSample]>>,
    /// Legs without fixes.
    pub gaps: Option<Gaps>,
    /// Share of the fixes that are of another place.
    pub alias_share: f64,
    /// Mean number of frames that a wrong place repeats.
    pub alias_frames: f64,
    /// How confident wrong fixes are.
    pub confidence: Confidence,
    /// Fixes come late by up to this, seconds, each by another time, so that they swap.
    pub latest_s: f64,
    /// Whether attitude and height are reported.
    pub attitude: bool,
    /// Whether the autopilot's velocity is reported.
    pub velocity: bool,
    /// Whether motion between frames is measured.
    pub motion: bool,
    /// When the aircraft is put elsewhere, seconds.
    pub put_elsewhere_s: Option<f64>,
    /// Offset of the map, metres per axis, 1 sigma.
    pub map_error_m: f64,
    /// Boresight, degrees per axis, 1 sigma.
    pub boresight_deg: f64,
    /// Error of roll and pitch, degrees, 1 sigma.
    pub attitude_sigma_deg: f64,
    /// Error of the velocity per axis, metres per second, 1 sigma.
    pub velocity_sigma_m_s: f64,
    /// Correlation time of the velocity's error, seconds.
    pub velocity_correlation_s: f64,
}

impl Default for FlightOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            duration_s: 600.0,
            frame_rate_hz: 2.0,
            vehicle: Vehicle::Multirotor,
            camera: Camera::Fixed,
            height_agl_m: 120.0,
            focal_length_px: 2800.0,
            area: None,
            fix_rate: 0.9,
            fixes: None,
            gaps: None,
            alias_share: 0.1,
            alias_frames: 3.0,
            confidence: Confidence::Calibrated,
            latest_s: 0.0,
            attitude: true,
            velocity: true,
            motion: false,
            put_elsewhere_s: None,
            map_error_m: 1.0,
            boresight_deg: 1.0,
            attitude_sigma_deg: 0.5,
            velocity_sigma_m_s: 0.3,
            velocity_correlation_s: 60.0,
        }
    }
}

/// The plane of simulation is around this place, if no area is given.
const ORIGIN: LonLat = LonLat::new(120.72, 24.24);

impl FlightOptions {
    /// Where the flight begins.
    pub(super) fn origin(&self) -> LonLat {
        self.area.map_or(ORIGIN, |area| area.centre)
    }
}
