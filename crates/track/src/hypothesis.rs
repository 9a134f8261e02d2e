//! One hypothesis of where the aircraft is: a small Kalman filter.
//!
//! The reference velocity is what the autopilot or the motion between frames says; without either it is zero. What is left of
//! the velocity is a first-order Gauss-Markov process in each case, with its own size and correlation time.

use nalgebra::{Matrix2, Vector2};

use crate::{
    confidence::Support,
    input::{PositionFix, Velocity},
    journal::Journal,
    kalman::{
        BORESIGHT, Covariance, ESTIMATED, MAP, Observation, POSITION, STATE, State, TILT,
        UNKNOWN_TILT, VELOCITY, set_diagonal, update,
    },
    options::TrackOptions,
    reference::{Reference, ReferenceKind},
    scalar::{GsdFilter, HeadingFilter},
    sensors::Sensors,
    tilt_error::tilt_errors,
    velocity_gate::VelocityUse,
};

/// How a heading that nothing measures may turn, degrees in the square root of a second.
const HEADING_SPREAD_DEG: f64 = 10.0;

/// Fixes that a hypothesis remembers having accepted or not.
pub(crate) const FIXES_IN_HISTORY: usize = 128;

/// What point the position is, and where the error of the view's tilt comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum PositionOf {
    /// The aircraft, found with attitude and height.
    Aircraft,
    /// The aircraft, of which no attitude is known: the unknown tilt of the camera is part of the covariance.
    AircraftWithoutAttitude,
    /// The ground point at the photo's centre: the height is not known.
    ImageCentre,
}

/// See the module.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hypothesis {
    pub id: u64,
    pub weight: f64,
    pub time_s: f64,
    pub mean: State,
    pub covariance: Covariance,
    pub(crate) reference: Reference,
    pub(crate) position_of: PositionOf,
    /// Height above ground in the latest view of which it was known, metres.
    pub(crate) height_agl_m: Option<f64>,
    pub heading: Option<HeadingFilter>,
    pub(crate) heading_time_s: f64,
    /// Ground resolution straight below.
    pub gsd: Option<GsdFilter>,
    /// Fixes that were accepted.
    pub fixes: u32,
    pub last_fix_s: Option<f64>,
    pub distance_since_fix_m: f64,
    /// Whether the last fix was of another place, according to this hypothesis.
    pub last_was_wrong: bool,
    /// Fixes in a row that were accepted.
    pub support: Support,
    /// The hypothesis's first ancestor: hypotheses are split in two and merged.
    pub root: u64,
    /// Fixes since it was founded.
    pub fixes_seen: u32,
    /// Which of them were accepted, the latest in the lowest bit.
    pub history: u128,
    /// What is needed for smoothing, if that is wanted. All states are then estimated.
    pub journal: Option<Box<Journal>>,
    /// Squared Mahalanobis distance of the last fix that was tested, over the gate.
    pub test_ratio: f64,
}

impl Hypothesis {
    /// A hypothesis around a place that is known to `sigma_m` per axis, without any fix.
    pub fn at_start(
        id: u64,
        time_s: f64,
        place_m: Vector2<f64>,
        sigma_m: f64,
        sensors: &Sensors,
        options: &TrackOptions,
    ) -> Self {
        let mut new = Self::unplaced(id, time_s, options);
        new.know_yaw(sensors, options);
        new.mean.fixed_rows_mut::<2>(POSITION).copy_from(&place_m);
        set_diagonal(&mut new.covariance, POSITION, sigma_m * sigma_m);
        new.know_velocity(sensors, options);
        new
    }

    /// A hypothesis founded by a fix.
    pub fn from_fix(
        id: u64,
        fix: &PositionFix,
        measured_m: Vector2<f64>,
        sensors: &Sensors,
        options: &TrackOptions,
    ) -> Self {
        let mut new = Self::unplaced(id, fix.time_s, options);
        new.know_map_error(fix);
        new.know_yaw(sensors, options);
        let view = sensors.view_of(fix, options);
        new.look(view);
        let (predicted_m, observation, noise) = new.measurement(fix, view, options);
        // Not before: the heading of the fix is part of its view, and counts once.
        new.take_heading_and_gsd(fix, options);
        // The position's own column is the identity, so position = measured - (everything else) - noise.
        let mut others = -observation;
        others.fixed_columns_mut::<2>(POSITION).fill(0.0);
        let cross = others * new.covariance;
        let own = cross * others.transpose() + noise;
        new.mean
            .fixed_rows_mut::<2>(POSITION)
            .copy_from(&(measured_m - predicted_m));
        new.covariance
            .fixed_rows_mut::<2>(POSITION)
            .copy_from(&cross);
        new.covariance
            .fixed_columns_mut::<2>(POSITION)
            .copy_from(&cross.transpose());
        new.covariance
            .fixed_view_mut::<2, 2>(POSITION, POSITION)
            .copy_from(&own);
        new.know_velocity(sensors, options);
        new.fixes = 1;
        new.see(true);
        new.last_fix_s = Some(fix.time_s);
        new
    }

    /// Takes in the yaw of the latest attitude, if it is recent.
    fn know_yaw(&mut self, sensors: &Sensors, options: &TrackOptions) {
        if let Some(yaw_deg) = sensors.yaw_deg(self.time_s) {
            self.heading = Some(HeadingFilter::new(yaw_deg, options.compass_sigma_deg));
        }
    }

    /// Takes in the latest velocity, if it still holds.
    fn know_velocity(&mut self, sensors: &Sensors, options: &TrackOptions) {
        if let Some(velocity) = sensors.velocity_at(self.time_s, options.hold_s) {
            let now = Velocity {
                time_s: self.time_s,
                ..velocity
            };
            self.velocity(&now, VelocityUse::Continues, options);
        }
    }

    fn unplaced(id: u64, time_s: f64, options: &TrackOptions) -> Self {
        let mut covariance = Covariance::zeros();
        set_diagonal(
            &mut covariance,
            VELOCITY,
            options.vehicle.speed_sigma_m_s().powi(2),
        );
        let boresight_rad = options.boresight_sigma_deg.to_radians();
        set_diagonal(&mut covariance, BORESIGHT, boresight_rad.powi(2));
        for (at, error) in tilt_errors(options) {
            set_diagonal(&mut covariance, at, error.sigma.powi(2));
        }
        Self {
            id,
            weight: 0.0,
            time_s,
            mean: State::zeros(),
            covariance,
            reference: Reference::FREE,
            position_of: PositionOf::ImageCentre,
            height_agl_m: None,
            heading: None,
            heading_time_s: time_s,
            gsd: None,
            fixes: 0,
            last_fix_s: None,
            distance_since_fix_m: 0.0,
            last_was_wrong: false,
            support: Support::default(),
            root: id,
            fixes_seen: 0,
            history: 0,
            journal: None,
            test_ratio: 0.0,
        }
    }

    /// Metres east and north.
    pub fn position_m(&self) -> Vector2<f64> {
        self.mean.fixed_rows::<2>(POSITION).into_owned()
    }

    /// Metres per second east and north.
    pub fn velocity_m_s(&self) -> Vector2<f64> {
        self.reference.velocity_m_s + self.mean.fixed_rows::<2>(VELOCITY)
    }

    /// Covariance of the position, square metres.
    pub fn position_covariance_m2(&self) -> Matrix2<f64> {
        self.covariance
            .fixed_view::<2, 2>(POSITION, POSITION)
            .into_owned()
    }

    /// Covariance of the velocity, square metres per square second.
    pub fn velocity_covariance_m2_s2(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(VELOCITY, VELOCITY)
            + Matrix2::identity() * self.reference.variance_m2_s2
    }

    pub fn position_of(&self) -> PositionOf {
        self.position_of
    }

    /// What tells the velocity at the hypothesis's time.
    pub fn reference_kind(&self, options: &TrackOptions) -> ReferenceKind {
        let since_s = self.time_s - self.reference.time_s;
        match self.reference.kind {
            ReferenceKind::Free if since_s <= options.hold_s => ReferenceKind::Motion,
            kind => kind,
        }
    }

    /// Counts a fix that was accepted or not.
    pub fn see(&mut self, accepted: bool) {
        self.last_was_wrong = !accepted;
        if !accepted {
            self.support = Support::default();
        }
        self.fixes_seen = self.fixes_seen.saturating_add(1);
        self.history = self.history << 1 | u128::from(accepted);
    }

    /// A measurement: how it depends on the state, measured minus predicted, and the covariance of that.
    pub(crate) fn measure(
        &mut self,
        observation: &Observation,
        innovation: Vector2<f64>,
        covariance: Matrix2<f64>,
    ) {
        let estimated = if self.journal.is_some() {
            STATE
        } else {
            ESTIMATED
        };
        let predicted = self
            .journal
            .is_some()
            .then_some((self.mean, self.covariance));
        update(
            &mut self.mean,
            &mut self.covariance,
            observation,
            innovation,
            covariance,
            estimated,
        );
        if let (Some(journal), Some(predicted)) = (&mut self.journal, predicted) {
            let reference_m_s = self.reference.velocity_m_s;
            let filtered = (self.mean, self.covariance);
            journal.write(self.time_s, reference_m_s, predicted, filtered);
        }
    }

    /// Writes the state as it is into the journal.
    pub fn write_epoch(&mut self) {
        let state = (self.mean, self.covariance);
        if let Some(journal) = &mut self.journal {
            journal.write(self.time_s, self.reference.velocity_m_s, state, state);
        }
    }

    /// Moves the hypothesis to another plane.
    pub fn re_anchor(&mut self, position_m: Vector2<f64>, turn: nalgebra::Rotation2<f64>) {
        let mut transform = Covariance::identity();
        for block in [POSITION, VELOCITY, MAP, TILT, UNKNOWN_TILT] {
            transform
                .fixed_view_mut::<2, 2>(block, block)
                .copy_from(turn.matrix());
        }
        self.mean = transform * self.mean;
        self.mean
            .fixed_rows_mut::<2>(POSITION)
            .copy_from(&position_m);
        self.reference.velocity_m_s = turn * self.reference.velocity_m_s;
        self.covariance = transform * self.covariance * transform.transpose();
        if let Some(journal) = &mut self.journal {
            journal.transition = transform * journal.transition;
        }
    }

    pub(crate) fn spread_heading(&mut self, time_s: f64) {
        let dt_s = time_s - self.heading_time_s;
        if let Some(heading) = &mut self.heading
            && dt_s > 0.0
        {
            heading.turn(0.0, HEADING_SPREAD_DEG * dt_s.sqrt());
            self.heading_time_s = time_s;
        }
    }

    /// The heading at a time that is not before the latest input.
    pub fn heading_at(&self, time_s: f64) -> Option<HeadingFilter> {
        let mut heading = self.heading?;
        let dt_s = (time_s - self.heading_time_s).max(0.0);
        heading.turn(0.0, HEADING_SPREAD_DEG * dt_s.sqrt());
        Some(heading)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        attitude::Attitude,
        input::{Height, Input, tests::fix},
    };

    #[test]
    fn the_heading_of_the_first_fix_counts_once() {
        let east_m2 = |heading_sigma_deg: f64| {
            let options = TrackOptions {
                heading_sigma_deg,
                ..TrackOptions::default()
            };
            let first = PositionFix {
                heading_deg: Some(0.0),
                ..fix()
            };
            let mut sensors = Sensors::default();
            sensors.take(&Input::Attitude(Attitude {
                time_s: first.time_s,
                yaw_deg: 0.0,
                pitch_deg: 20.0,
                roll_deg: 0.0,
            }));
            sensors.take(&Input::Height(Height {
                time_s: first.time_s,
                agl_m: 100.0,
                amsl_m: None,
            }));
            let founded = Hypothesis::from_fix(0, &first, Vector2::zeros(), &sensors, &options);
            founded.position_covariance_m2()[(0, 0)]
        };
        let compass_deg = TrackOptions::default().compass_sigma_deg;
        let by_heading_m2 = east_m2(1.5) - east_m2(1e-6);
        // Of the compass and the fix together.
        let sigma_deg = (compass_deg.powi(-2) + 1.5f64.powi(-2)).sqrt().recip();
        let ahead_m = 100.0 * 20f64.to_radians().tan();
        let expected_m2 = (ahead_m * sigma_deg.to_radians()).powi(2);
        assert!(
            (by_heading_m2 / expected_m2 - 1.0).abs() < 1e-6,
            "{by_heading_m2} {expected_m2}"
        );
    }
}
