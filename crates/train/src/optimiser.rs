//! Adam (Kingma and Ba 2015) over the named parameters, with a learning rate per group and clipping by the global norm.

use crate::TrainError;
use crate::parameters::{Parameters, host};
use burn::tensor::{Gradients, Tensor};
use std::collections::BTreeMap;

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.99;
const EPSILON: f32 = 1e-8;

/// The moments of all parameters that have moved.
#[derive(Clone, Debug, Default)]
pub struct Adam {
    /// Updates made.
    pub updates: u64,
    /// First and second moment by tensor name, flat.
    pub moments: BTreeMap<String, (Tensor<1>, Tensor<1>)>,
}

impl Adam {
    /// Moves the parameters against their gradients.
    ///
    /// `rate_of` gives each tensor's learning rate. Gradients longer together than `clip` are shortened to it. Returns the
    /// gradients' length before that; where it is not finite, nothing moves.
    ///
    /// # Errors
    /// Where the device does not give values back, or the parameters are not those of `tracked`.
    pub fn step(
        &mut self,
        parameters: &mut Parameters,
        tracked: &Parameters,
        gradients: &mut Gradients,
        clip: f32,
        rate_of: impl Fn(&str) -> f32,
    ) -> Result<f32, TrainError> {
        let mut found = Vec::new();
        let mut squares: Option<Tensor<1>> = None;
        for name in tracked.trained_names() {
            let Some(gradient) = tracked.flat(&name)?.grad_remove(gradients) else {
                continue;
            };
            let square = gradient.clone().square().sum();
            squares = Some(match squares {
                Some(sum) => sum + square,
                None => square,
            });
            found.push((name, gradient));
        }
        let Some(squares) = squares else {
            return Ok(0.0);
        };
        let length = host(squares)?.first().copied().unwrap_or(0.0).sqrt();
        if !length.is_finite() {
            return Ok(length);
        }
        self.updates += 1;
        let shorten = (clip / length.max(f32::MIN_POSITIVE)).min(1.0);
        let updates = i32::try_from(self.updates).unwrap_or(i32::MAX);
        let correction = (1.0 - BETA_2.powi(updates)).sqrt() / (1.0 - BETA_1.powi(updates));
        for (name, gradient) in found {
            let gradient = gradient.mul_scalar(shorten);
            let (first, second) = match self.moments.remove(&name) {
                Some((first, second)) => (
                    first.mul_scalar(BETA_1) + gradient.clone().mul_scalar(1.0 - BETA_1),
                    second.mul_scalar(BETA_2) + gradient.square().mul_scalar(1.0 - BETA_2),
                ),
                None => (
                    gradient.clone().mul_scalar(1.0 - BETA_1),
                    gradient.square().mul_scalar(1.0 - BETA_2),
                ),
            };
            let direction = first.clone() / second.clone().sqrt().add_scalar(EPSILON);
            let value = parameters.flat(&name)? - direction.mul_scalar(rate_of(&name) * correction);
            parameters.set(&name, value)?;
            self.moments.insert(name, (first, second));
        }
        Ok(length)
    }
}
