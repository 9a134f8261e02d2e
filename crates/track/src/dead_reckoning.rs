//! How a hypothesis takes in velocity, motion between frames and turns.

use nalgebra::{Matrix2, Vector2};

use crate::{
    attitude::Attitude,
    climb::Climb,
    hypothesis::{Hypothesis, PositionOf},
    input::{RelativeMotion, Velocity},
    kalman::{Covariance, Observation, POSITION, VELOCITY, set_diagonal},
    observation::{lean, position_of},
    options::TrackOptions,
    reference::{Reference, ReferenceKind},
    scalar::HeadingFilter,
    sensors::{Change, Sensors, View},
    tilt_error::{attitude_tilt_error, unknown_tilt},
    velocity_gate::VelocityUse,
};

/// Error of the turn between two attitudes, degrees in the square root of a second.
const TURN_SIGMA_DEG: f64 = 0.2;
/// Error of the turn between two frames, degrees.
const FRAME_TURN_SIGMA_DEG: f64 = 1.0;
/// Motion between frames is never better than this, metres per second.
const LEAST_MOTION_SIGMA_M_S: f64 = 0.1;
/// What can still be matched after this time is solid, seconds: waves that a drone's photo resolves (1-15 m long, so periods of
/// 0.8-3.1 s in deep water) run apart within two periods, because each length has its own speed.
const WAVES_KEEP_SHAPE_S: f64 = 6.0;

/// How much the surface may have moved; see [`RelativeMotion::surface_sigma_px`].
fn surface_sigma_px(motion: &RelativeMotion) -> Option<f64> {
    let keeps_its_shape = motion.time_s - motion.from_time_s >= WAVES_KEEP_SHAPE_S;
    motion.surface_sigma_px.or(keeps_its_shape.then_some(0.0))
}

impl Hypothesis {
    /// Takes in the autopilot's velocity.
    pub fn velocity(&mut self, measured: &Velocity, how: VelocityUse, options: &TrackOptions) {
        self.propagate(measured.time_s, options);
        let now_m_s = Vector2::new(measured.east_m_s, measured.north_m_s);
        let was_held = self.reference.kind == ReferenceKind::Velocity;
        let moved_m = if was_held {
            self.follow_straight_line(now_m_s, measured.time_s)
        } else {
            Vector2::zeros()
        };
        match how {
            VelocityUse::Continues if was_held => {}
            VelocityUse::Continues => {
                self.release();
                self.update_velocity(now_m_s, measured.sigma_m_s.powi(2));
                self.refer_to(now_m_s);
            }
            VelocityUse::Steps => {
                // One of the two velocities is wrong by the step, and it is not known when between them it was.
                let step_m_s = (now_m_s - self.velocity_m_s()).norm();
                for axis in POSITION..POSITION + 2 {
                    self.covariance[(axis, axis)] += moved_m.norm_squared();
                }
                self.forget_velocity(measured.sigma_m_s.hypot(step_m_s));
            }
        }
        self.reference = Reference {
            kind: ReferenceKind::Velocity,
            velocity_m_s: now_m_s,
            time_s: measured.time_s,
            sigma_m_s: measured.sigma_m_s,
            surface_m_s: 0.0,
            variance_m2_s2: 0.0,
        };
    }

    /// The last velocity was held: puts right what lies between by the straight line from it to this one, from the last fix on, which
    /// saw the position itself. Gives by how much, metres.
    fn follow_straight_line(&mut self, now_m_s: Vector2<f64>, to_s: f64) -> Vector2<f64> {
        let from_s = self.reference.time_s;
        let interval_s = to_s - from_s;
        if interval_s <= 0.0 {
            return Vector2::zeros();
        }
        let since_s = self.last_fix_s.map_or(from_s, |fix_s| fix_s.max(from_s)) - from_s;
        let seconds = (interval_s * interval_s - since_s * since_s) / (2.0 * interval_s);
        let moved_m = (now_m_s - self.reference.velocity_m_s) * seconds;
        let mut position = self.mean.fixed_rows_mut::<2>(POSITION);
        position += moved_m;
        moved_m
    }

    /// Takes in motion between frames.
    ///
    /// It was found in photos that were levelled with the reported attitude, so it is off by how much the error of the view's tilt
    /// moved the image centre at the second photo, less how much at the first. That error is part of the state: what is carried
    /// on is the position as the photos see it, and no error of an attitude is added up.
    pub fn motion(&mut self, motion: &RelativeMotion, sensors: &Sensors, options: &TrackOptions) {
        let heading_before = self.turn_between_frames(motion);
        let velocity_is_known = self.reference.kind == ReferenceKind::Velocity
            && motion.time_s <= self.reference.time_s + options.hold_s;
        let (Some(heading), Some(gsd), Some(surface_px), false) = (
            heading_before,
            self.gsd,
            surface_sigma_px(motion),
            velocity_is_known,
        ) else {
            return;
        };
        self.propagate(motion.from_time_s, options);
        if self.time_s >= motion.time_s {
            return;
        }
        let interval_s = motion.time_s - motion.from_time_s;
        let (sin, cos) = heading.heading_deg.to_radians().sin_cos();
        let mean_m_s = Vector2::new(
            motion.forward_px * sin + motion.right_px * cos,
            motion.forward_px * cos - motion.right_px * sin,
        ) * (gsd.gsd_m() / interval_s);
        let relative = (options.motion_sigma.powi(2)
            + heading.variance_deg2.to_radians() * 1f64.to_radians()
            + gsd.variance)
            .sqrt();
        let surface_m_s = surface_px * gsd.gsd_m() / interval_s;
        let sigma_m_s = (relative * mean_m_s.norm())
            .hypot(surface_m_s)
            .max(LEAST_MOTION_SIGMA_M_S);
        let white_m2 = (motion.sigma_px * gsd.gsd_m()).powi(2);
        let (velocity_m_s, variance_m2_s2) = self.velocity_before(motion, mean_m_s, options);
        if self.reference.kind != ReferenceKind::Motion {
            self.forget_velocity(sigma_m_s);
        } else if surface_m_s > self.reference.surface_m_s {
            // Another error, which begins as large as it is.
            let added = surface_m_s.powi(2) - self.reference.surface_m_s.powi(2);
            for axis in VELOCITY..VELOCITY + 2 {
                self.covariance[(axis, axis)] += added;
            }
        }
        self.reference.kind = ReferenceKind::Motion;
        self.reference.sigma_m_s = sigma_m_s;
        self.reference.velocity_m_s = mean_m_s;
        let views = sensors.views_of(motion, Some(gsd.gsd_m()), options);
        let lean_m2 = self.carry_as_seen(motion.time_s, views, options);
        for axis in POSITION..POSITION + 2 {
            self.covariance[(axis, axis)] += white_m2 + lean_m2;
        }
        // The mean over the interval is the velocity at its end but for half the interval's acceleration.
        let unsteady = options.vehicle.acceleration_density_m2_s3() * interval_s / 3.0;
        let of_mean = (white_m2 + self.lean_change_m2(interval_s, views, options))
            / (interval_s * interval_s)
            + unsteady;
        let gain = variance_m2_s2 / (variance_m2_s2 + of_mean);
        self.reference = Reference {
            kind: ReferenceKind::Motion,
            velocity_m_s: velocity_m_s + (mean_m_s - velocity_m_s) * gain,
            time_s: motion.time_s,
            sigma_m_s,
            surface_m_s,
            variance_m2_s2: variance_m2_s2 * (1.0 - gain),
        };
    }

    /// The velocity at the second frame as it was known before the motion, and its variance per axis.
    fn velocity_before(
        &self,
        motion: &RelativeMotion,
        mean_m_s: Vector2<f64>,
        options: &TrackOptions,
    ) -> (Vector2<f64>, f64) {
        let gained =
            options.vehicle.acceleration_density_m2_s3() * (motion.time_s - motion.from_time_s);
        match self.reference.kind {
            ReferenceKind::Motion => (
                self.reference.velocity_m_s,
                self.reference.variance_m2_s2 + gained,
            ),
            // What fixes tell of the velocity is correlated with the position, and less than what motion tells.
            ReferenceKind::Free | ReferenceKind::Velocity => {
                (mean_m_s, options.vehicle.speed_sigma_m_s().powi(2))
            }
        }
    }

    /// From now on the velocity is a new reference's, with an error of its own.
    fn forget_velocity(&mut self, sigma_m_s: f64) {
        self.mean.fixed_rows_mut::<2>(VELOCITY).fill(0.0);
        self.covariance.fixed_rows_mut::<2>(VELOCITY).fill(0.0);
        self.covariance.fixed_columns_mut::<2>(VELOCITY).fill(0.0);
        set_diagonal(&mut self.covariance, VELOCITY, sigma_m_s * sigma_m_s);
        if let Some(journal) = &mut self.journal {
            journal.transition.fixed_rows_mut::<2>(VELOCITY).fill(0.0);
        }
    }

    /// Carries the position as photos see it to the time of the second one. Gives what the variance per axis does not hold yet.
    ///
    /// Where the two views are of two kinds, the motion is that of the aircraft or that of the image centre, and not from the one to the
    /// other: the unknown tilt itself is not in it, but how it changed.
    fn carry_as_seen(&mut self, time_s: f64, views: [View; 2], options: &TrackOptions) -> f64 {
        let interval_s = time_s - self.time_s;
        let [first, second] = views.map(position_of);
        let is_of_centre = |position_of| position_of == PositionOf::ImageCentre;
        if first != second || is_of_centre(first) != is_of_centre(self.position_of) {
            self.step(time_s, options);
            return self.lean_change_m2(interval_s, views, options);
        }
        let [first, second] = views.map(lean);
        self.shear(&first);
        self.step(time_s, options);
        self.shear(&-second);
        0.0
    }

    /// Adds a function of boresight and tilt to the position.
    fn shear(&mut self, by: &Observation) {
        let moved = by * self.mean;
        let mut position = self.mean.fixed_rows_mut::<2>(POSITION);
        position += moved;
        let mut transform = Covariance::identity();
        let mut rows = transform.fixed_rows_mut::<2>(POSITION);
        rows += by;
        self.covariance = transform * self.covariance * transform.transpose();
        if let Some(journal) = &mut self.journal {
            journal.transition = transform * journal.transition;
        }
    }

    /// Variance per axis of a displacement that comes from the change of the tilt's error, square metres.
    fn lean_change_m2(&self, interval_s: f64, views: [View; 2], options: &TrackOptions) -> f64 {
        let (height_agl_m, error) = match views[1] {
            View::Attitude { height_agl_m, .. } => (height_agl_m, attitude_tilt_error(options)),
            View::Height { height_agl_m } => (height_agl_m, unknown_tilt(options)),
            View::Centre => return 0.0,
        };
        let lost = 1.0 - error.step(interval_s).decay;
        2.0 * lost * (height_agl_m * error.sigma).powi(2)
    }

    /// Turns the heading by the turn between two frames, if no attitude did, and gives the heading at the first one.
    fn turn_between_frames(&mut self, motion: &RelativeMotion) -> Option<HeadingFilter> {
        let heading = self.heading?;
        let middle_s = 0.5 * (motion.from_time_s + motion.time_s);
        if self.heading_time_s > middle_s {
            let mut before = heading;
            before.turn(-motion.turn_deg, FRAME_TURN_SIGMA_DEG);
            return Some(before);
        }
        self.turn(
            motion.from_time_s,
            motion.time_s,
            motion.turn_deg,
            FRAME_TURN_SIGMA_DEG,
        );
        Some(heading)
    }

    /// The attitude turned by `turn_deg` since `from_s`.
    fn turn_with_attitude(&mut self, from_s: f64, to_s: f64, turn_deg: f64) {
        self.turn(
            from_s,
            to_s,
            turn_deg,
            TURN_SIGMA_DEG * (to_s - from_s).max(0.0).sqrt(),
        );
    }

    fn turn(&mut self, from_s: f64, to_s: f64, turn_deg: f64, sigma_deg: f64) {
        self.spread_heading(from_s);
        let interval_s = to_s - from_s;
        if let Some(heading) = &mut self.heading {
            // Of attitudes of one time, as where times are rounded, each goes on from the one before.
            let share = if interval_s > 0.0 {
                ((to_s - self.heading_time_s) / interval_s).clamp(0.0, 1.0)
            } else {
                1.0
            };
            heading.turn(share * turn_deg, sigma_deg);
            self.heading_time_s = to_s.max(self.heading_time_s);
        }
    }

    /// Takes in an attitude and what changed since the one before.
    pub fn attitude(
        &mut self,
        attitude: &Attitude,
        change: Option<Change>,
        options: &TrackOptions,
    ) {
        self.start_heading(attitude.time_s, attitude.yaw_deg, options);
        if let Some(Change::Turn { from_s, turn_deg }) = change {
            self.turn_with_attitude(from_s, attitude.time_s, turn_deg);
        }
    }

    /// The yaw of an attitude, where no heading is known yet.
    fn start_heading(&mut self, time_s: f64, yaw_deg: f64, options: &TrackOptions) {
        if self.heading.is_none() {
            self.heading = Some(HeadingFilter::new(yaw_deg, options.compass_sigma_deg));
            self.heading_time_s = time_s;
        }
    }

    /// The height above ground changed.
    pub fn climb(&mut self, climb: Climb) {
        if let Some(gsd) = &mut self.gsd {
            gsd.scale(climb.factor, climb.sigma);
        }
    }

    /// A velocity measured with an error that is independent of the state. The reference must be zero.
    fn update_velocity(&mut self, measured_m_s: Vector2<f64>, variance: f64) {
        let mut observation = Observation::zeros();
        observation
            .fixed_columns_mut::<2>(VELOCITY)
            .copy_from(&Matrix2::identity());
        let covariance = self.velocity_covariance_m2_s2() + Matrix2::identity() * variance;
        let innovation = measured_m_s - self.velocity_m_s();
        self.measure(&observation, innovation, covariance);
    }
}
