//! Options of the filter: what is known of the vehicle, of the sensors and of the errors of fixes.

use grimnet_geo::LonLat;
use serde::{Deserialize, Serialize};

use crate::error::OptionsError;

/// What kind of vehicle carries the camera. It says how fast the velocity may change when nothing measures it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Vehicle {
    /// Can stop and turn at any time.
    #[default]
    Multirotor,
    /// Flies on, faster, and turns by banking.
    Plane,
}

impl Vehicle {
    /// Usual speed over ground per axis, metres per second, 1 sigma.
    pub(crate) fn speed_sigma_m_s(self) -> f64 {
        match self {
            Self::Multirotor => 8.0,
            Self::Plane => 18.0,
        }
    }

    /// Spectral density of the acceleration per axis, square metres per second cubed: about 2 m/s2 held for a second by a
    /// multirotor; for a plane what turns it into another direction, at its speed, every half minute.
    pub(crate) fn acceleration_density_m2_s3(self) -> f64 {
        match self {
            Self::Multirotor => 4.0,
            Self::Plane => 20.0,
        }
    }
}

/// Where the aircraft is at the first frame (a fix, a miss or a motion between frames).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Start {
    /// The place.
    pub lonlat: LonLat,
    /// The aircraft is within this distance with 95 % probability, metres.
    pub radius95_m: f64,
}

/// Options of a [`crate::Tracker`]. The defaults suit a small drone at 50-500 m above ground.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrackOptions {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// Where the aircraft is at the first frame. `None` if unknown. A filter that begins again during the flight goes without.
    pub start: Option<Start>,
    /// Focal length of the full-size photo, pixels. With it and a fix's ground resolution the height is known where no
    /// [`crate::Height`] comes.
    pub focal_length_px: Option<f64>,

    /// How late an input may be, seconds.
    pub lag_s: f64,
    /// A step of time larger than this is taken for a jump of the clock, seconds.
    pub clock_jump_s: f64,

    /// Area that is searched for the aircraft, square metres: a wrong fix lies anywhere in it.
    pub search_area_m2: f64,
    /// A higher confidence than this counts as this. It is above 1/2.
    pub full_confidence: f64,
    /// Probability that the first wrong fix after a right one repeats an earlier offset, as places that look alike do.
    pub alias_persistence: f64,
    /// Probability, at the time of a fix, that the leading hypothesis is wrong although fixes support it.
    pub jump_probability: f64,
    /// Mahalanobis gate of a fix: chi-square with two degrees of freedom.
    pub gate_chi2: f64,
    /// Weight that the leading hypothesis, with those of the same place, needs to be believed for the first time, and again after it was
    /// lost.
    pub acquire_weight: f64,
    /// Weight that it needs, likewise, to be believed in place of another one, and with the next fix after frames so far apart in time
    /// that its place became too uncertain.
    pub change_weight: f64,
    /// Weight that it needs, likewise, to stay believed.
    pub keep_weight: f64,
    /// Fixes that must support a hypothesis before it is believed.
    pub acquire_fixes: u32,

    /// Without a fix for longer than this the state is `coasting`, seconds.
    pub coasting_after_s: f64,
    /// With a 95 % radius above this the state is `lost`, metres.
    pub lost_radius_m: f64,
    /// A velocity or a motion between frames holds for this long, seconds; after that the velocity is free.
    pub hold_s: f64,

    /// Error of a fix's heading, degrees, 1 sigma.
    pub heading_sigma_deg: f64,
    /// Error of the attitude's yaw, degrees, 1 sigma (magnetic compasses are a few degrees off).
    pub compass_sigma_deg: f64,
    /// Relative error of a fix's ground resolution, 1 sigma.
    pub gsd_sigma: f64,
    /// Relative error of the height, 1 sigma.
    pub height_sigma: f64,
    /// Error of roll and pitch, degrees, 1 sigma.
    pub attitude_sigma_deg: f64,
    /// Correlation time of the error of roll and pitch, seconds.
    pub attitude_correlation_s: f64,
    /// How far the camera may be mounted off the attitude's frame, degrees per axis, 1 sigma. It is estimated.
    pub boresight_sigma_deg: f64,
    /// Tilt of the camera where no attitude is known, degrees per axis, 1 sigma.
    pub unknown_tilt_sigma_deg: f64,
    /// Correlation time of that tilt, seconds.
    pub unknown_tilt_correlation_s: f64,
    /// Correlation time of the error of the autopilot's velocity, seconds.
    pub velocity_correlation_s: f64,
    /// Error of motion measured between frames, relative to the distance, 1 sigma. It comes from tilt, relief and scale, so it
    /// changes slowly.
    pub motion_sigma: f64,
    /// Correlation time of that error, seconds.
    pub motion_correlation_s: f64,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            vehicle: Vehicle::default(),
            start: None,
            focal_length_px: None,
            lag_s: 30.0,
            clock_jump_s: 300.0,
            search_area_m2: 4.0e6,
            full_confidence: 0.998,
            alias_persistence: 0.5,
            jump_probability: 3e-5,
            gate_chi2: GATE_99_9_PERCENT,
            acquire_weight: 0.999,
            change_weight: 0.9998,
            keep_weight: 0.95,
            acquire_fixes: 3,
            coasting_after_s: 2.0,
            lost_radius_m: 300.0,
            hold_s: 1.5,
            heading_sigma_deg: 1.5,
            compass_sigma_deg: 8.0,
            gsd_sigma: 0.02,
            height_sigma: 0.03,
            attitude_sigma_deg: 0.5,
            attitude_correlation_s: 2.0,
            boresight_sigma_deg: 1.0,
            unknown_tilt_sigma_deg: 8.0,
            unknown_tilt_correlation_s: 20.0,
            velocity_correlation_s: 60.0,
            motion_sigma: 0.07,
            motion_correlation_s: 20.0,
        }
    }
}

/// The 99.9 % quantile of chi-square with two degrees of freedom, `-2 ln 0.001`.
pub const GATE_99_9_PERCENT: f64 = 13.815_510_557_964_274;

impl TrackOptions {
    /// Checks all options.
    ///
    /// # Errors
    /// [`OptionsError`] names the first option that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OptionsError> {
        let above_0 = [
            ("lag_s", self.lag_s),
            ("clock_jump_s", self.clock_jump_s),
            ("search_area_m2", self.search_area_m2),
            ("gate_chi2", self.gate_chi2),
            ("coasting_after_s", self.coasting_after_s),
            ("lost_radius_m", self.lost_radius_m),
            ("hold_s", self.hold_s),
            ("heading_sigma_deg", self.heading_sigma_deg),
            ("compass_sigma_deg", self.compass_sigma_deg),
            ("gsd_sigma", self.gsd_sigma),
            ("height_sigma", self.height_sigma),
            ("attitude_sigma_deg", self.attitude_sigma_deg),
            ("attitude_correlation_s", self.attitude_correlation_s),
            ("boresight_sigma_deg", self.boresight_sigma_deg),
            ("unknown_tilt_sigma_deg", self.unknown_tilt_sigma_deg),
            (
                "unknown_tilt_correlation_s",
                self.unknown_tilt_correlation_s,
            ),
            ("velocity_correlation_s", self.velocity_correlation_s),
            ("motion_sigma", self.motion_sigma),
            ("motion_correlation_s", self.motion_correlation_s),
            ("focal_length_px", self.focal_length_px.unwrap_or(1.0)),
            (
                "start.radius95_m",
                self.start.map_or(1.0, |start| start.radius95_m),
            ),
        ];
        for (name, value) in above_0 {
            require(
                name,
                value,
                value.is_finite() && value > 0.0,
                "finite and above 0",
            )?;
        }
        let probabilities = [
            ("full_confidence", self.full_confidence),
            ("alias_persistence", self.alias_persistence),
            ("jump_probability", self.jump_probability),
            ("acquire_weight", self.acquire_weight),
            ("change_weight", self.change_weight),
            ("keep_weight", self.keep_weight),
        ];
        for (name, value) in probabilities {
            require(
                name,
                value,
                value > 0.0 && value < 1.0,
                "between 0 and 1, neither included",
            )?;
        }
        require(
            "full_confidence",
            self.full_confidence,
            self.full_confidence > 0.5,
            "above 1/2",
        )?;
        if let Some(start) = self.start {
            let LonLat { lon_deg, lat_deg } = start.lonlat;
            require(
                "start.lonlat.lat_deg",
                lat_deg,
                (-90.0..=90.0).contains(&lat_deg),
                "in [-90, 90]",
            )?;
            require(
                "start.lonlat.lon_deg",
                lon_deg,
                lon_deg.is_finite(),
                "finite",
            )?;
        }
        Ok(())
    }
}

fn require(
    name: &'static str,
    value: f64,
    holds: bool,
    expected: &'static str,
) -> Result<(), OptionsError> {
    if holds {
        Ok(())
    } else {
        Err(OptionsError {
            name,
            value,
            expected,
        })
    }
}
