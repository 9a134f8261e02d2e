//! Time passes for a hypothesis: what tells the velocity, how long it holds, and how uncertain it becomes.

use nalgebra::Vector2;

use crate::{
    gauss_markov::GaussMarkov,
    hypothesis::Hypothesis,
    kalman::{Covariance, POSITION, STATE, VELOCITY},
    options::TrackOptions,
    reference::{Reference, ReferenceKind},
    tilt_error::tilt_errors,
};

/// How a ground resolution that nothing measures may change, relative, in the square root of a second.
const GSD_SPREAD: f64 = 0.02;

impl Hypothesis {
    /// Carries the hypothesis to a later time. An earlier time changes nothing.
    pub fn propagate(&mut self, time_s: f64, options: &TrackOptions) {
        let held_until_s = match self.reference.kind {
            ReferenceKind::Free => f64::INFINITY,
            ReferenceKind::Velocity => self.reference.time_s + options.hold_s,
            // It is of the time up to the second frame; from there on it is a guess.
            ReferenceKind::Motion => self.reference.time_s,
        };
        if time_s > held_until_s {
            self.step(held_until_s, options);
            self.release();
        }
        self.step(time_s, options);
    }

    /// From now on nothing measures the velocity.
    pub(crate) fn release(&mut self) {
        self.refer_to(Vector2::zeros());
        for axis in VELOCITY..VELOCITY + 2 {
            self.covariance[(axis, axis)] += self.reference.variance_m2_s2;
        }
        let time_s = match self.reference.kind {
            ReferenceKind::Motion => self.reference.time_s,
            ReferenceKind::Velocity | ReferenceKind::Free => f64::NEG_INFINITY,
        };
        self.reference = Reference {
            time_s,
            ..Reference::FREE
        };
    }

    /// Expresses the velocity relative to another reference.
    pub(crate) fn refer_to(&mut self, velocity_m_s: Vector2<f64>) {
        let relative = self.velocity_m_s() - velocity_m_s;
        self.mean.fixed_rows_mut::<2>(VELOCITY).copy_from(&relative);
        self.reference.velocity_m_s = velocity_m_s;
    }

    fn process(&self, options: &TrackOptions) -> GaussMarkov {
        match self.reference.kind {
            ReferenceKind::Free => {
                let sigma = options.vehicle.speed_sigma_m_s();
                GaussMarkov {
                    sigma,
                    // Spectral density of the driving noise is 2 sigma^2 / tau.
                    correlation_s: 2.0 * sigma * sigma
                        / options.vehicle.acceleration_density_m2_s3(),
                }
            }
            ReferenceKind::Velocity => GaussMarkov {
                sigma: self.reference.sigma_m_s,
                correlation_s: options.velocity_correlation_s,
            },
            ReferenceKind::Motion => GaussMarkov {
                sigma: self.reference.sigma_m_s,
                correlation_s: options.motion_correlation_s,
            },
        }
    }

    pub(crate) fn step(&mut self, time_s: f64, options: &TrackOptions) {
        let dt_s = time_s - self.time_s;
        if dt_s <= 0.0 {
            return;
        }
        self.time_s = time_s;
        self.distance_since_fix_m += self.velocity_m_s().norm() * dt_s;
        let step = self.process(options).step(dt_s);
        for axis in 0..2 {
            let (p, v) = (POSITION + axis, VELOCITY + axis);
            self.mean[p] += self.reference.velocity_m_s[axis] * dt_s + step.gain_s * self.mean[v];
            self.mean[v] *= step.decay;
            // F P F^T for the identity but for two entries.
            for column in 0..STATE {
                let carried = step.gain_s * self.covariance[(v, column)];
                self.covariance[(p, column)] += carried;
                self.covariance[(v, column)] *= step.decay;
            }
            for row in 0..STATE {
                let carried = step.gain_s * self.covariance[(row, v)];
                self.covariance[(row, p)] += carried;
                self.covariance[(row, v)] *= step.decay;
            }
            self.covariance[(p, p)] += step.noise[(0, 0)];
            self.covariance[(p, v)] += step.noise[(0, 1)];
            self.covariance[(v, p)] += step.noise[(1, 0)];
            self.covariance[(v, v)] += step.noise[(1, 1)];
        }
        let tilt_steps = tilt_errors(options).map(|(at, error)| (at, error.step(dt_s)));
        for (at, tilt_step) in &tilt_steps {
            for tilt in *at..at + 2 {
                self.mean[tilt] *= tilt_step.decay;
                // F P F^T, so that the tilt's own block decays twice.
                self.covariance.row_mut(tilt).scale_mut(tilt_step.decay);
                self.covariance.column_mut(tilt).scale_mut(tilt_step.decay);
                // What is considered keeps its variance by this; what is estimated for smoothing is forgotten.
                self.covariance[(tilt, tilt)] += tilt_step.noise[(1, 1)];
            }
        }
        if let Some(journal) = &mut self.journal {
            let mut transition = Covariance::identity();
            for axis in 0..2 {
                transition[(POSITION + axis, VELOCITY + axis)] = step.gain_s;
                transition[(VELOCITY + axis, VELOCITY + axis)] = step.decay;
                for (at, tilt_step) in &tilt_steps {
                    transition[(at + axis, at + axis)] = tilt_step.decay;
                }
            }
            journal.transition = transition * journal.transition;
        }
        if let Some(gsd) = &mut self.gsd {
            gsd.spread(GSD_SPREAD * GSD_SPREAD * dt_s);
        }
    }
}
