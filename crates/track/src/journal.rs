//! What a hypothesis writes down while it filters, so that the flight can be smoothed afterwards.

use nalgebra::Vector2;

use crate::{
    kalman::{Covariance, STATE, State},
    rts::Epoch,
};

/// The epochs of one hypothesis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Journal {
    /// Transition since the last epoch.
    pub transition: Covariance,
    pub epochs: Vec<Epoch<STATE>>,
    /// Time of each epoch, seconds, and the velocity that the state is relative to, metres per second.
    pub at: Vec<(f64, Vector2<f64>)>,
}

impl Journal {
    pub fn new() -> Self {
        Self {
            transition: Covariance::identity(),
            epochs: Vec::new(),
            at: Vec::new(),
        }
    }

    /// Writes an epoch: the state before and after a measurement.
    pub fn write(
        &mut self,
        time_s: f64,
        reference_m_s: Vector2<f64>,
        predicted: (State, Covariance),
        filtered: (State, Covariance),
    ) {
        self.epochs.push(Epoch {
            transition: self.transition,
            predicted_mean: predicted.0,
            predicted_covariance: predicted.1,
            mean: filtered.0,
            covariance: filtered.1,
        });
        self.at.push((time_s, reference_m_s));
        self.transition = Covariance::identity();
    }
}
