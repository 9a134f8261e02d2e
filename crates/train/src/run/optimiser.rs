//! The Adam optimiser (Kingma and Ba 2015), with a learning rate for each tensor and clipping by the global norm.

use crate::error::TrainError;
use crate::model::parameters::{Parameters, host};
use burn::tensor::{Gradients, Tensor};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Settings of Adam.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdamOptions {
    /// Decay of the first moment, per update.
    pub beta1: f32,
    /// Decay of the second moment, per update.
    pub beta2: f32,
    /// Added to the root of the corrected second moment.
    pub epsilon: f32,
}

impl Default for AdamOptions {
    /// PyTorch's, but for a second moment that follows faster, which suits short runs.
    fn default() -> Self {
        Self {
            beta2: 0.99,
            ..Self::pytorch()
        }
    }
}

impl AdamOptions {
    /// The default settings of PyTorch and of Kingma and Ba 2015.
    pub fn pytorch() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
        }
    }
}

/// The optimiser's state.
#[derive(Clone, Debug, Default)]
pub struct Adam {
    /// Number of updates of any tensor.
    pub updates: u64,
    /// The moments of each tensor that has been updated, by name.
    pub moments: BTreeMap<String, Moments>,
}

/// What Adam keeps of one tensor.
#[derive(Clone, Debug)]
pub struct Moments {
    /// Number of its updates, by which its moments are corrected: where tasks alternate, a tensor that serves one of them has fewer
    /// than there were steps.
    pub updates: u64,
    /// Running mean of its gradient, flat.
    pub first: Tensor<1>,
    /// Running mean of the squares of its gradient, flat.
    pub second: Tensor<1>,
}

/// Settings of an update.
#[derive(Clone, Copy, Debug)]
pub struct StepOptions {
    /// Adam's settings.
    pub adam: AdamOptions,
    /// Maximum norm of all gradients together; longer gradients are scaled down to it.
    pub clip: f32,
}

impl Adam {
    /// Updates the parameters by one step; `rate_of` gives the learning rate of each tensor. Returns the norm of all gradients
    /// before clipping. If the norm is not finite, the parameters do not change.
    ///
    /// # Errors
    /// Returns an error if values cannot be read from the device, or `tracked` does not have the tensors of `parameters`.
    pub fn step(
        &mut self,
        parameters: &mut Parameters,
        tracked: &Parameters,
        gradients: &mut Gradients,
        options: &StepOptions,
        rate_of: impl Fn(&str) -> f32,
    ) -> Result<f32, TrainError> {
        let AdamOptions {
            beta1,
            beta2,
            epsilon,
        } = options.adam;
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
        let scale = (options.clip / length.max(f32::MIN_POSITIVE)).min(1.0);
        for (name, gradient) in found {
            let gradient = gradient.mul_scalar(scale);
            let square = gradient.clone().square();
            let Moments {
                updates,
                first,
                second,
            } = match self.moments.remove(&name) {
                Some(kept) => Moments {
                    updates: kept.updates + 1,
                    first: kept.first.mul_scalar(beta1) + gradient.mul_scalar(1.0 - beta1),
                    second: kept.second.mul_scalar(beta2) + square.mul_scalar(1.0 - beta2),
                },
                None => Moments {
                    updates: 1,
                    first: gradient.mul_scalar(1.0 - beta1),
                    second: square.mul_scalar(1.0 - beta2),
                },
            };
            let exponent = i32::try_from(updates).unwrap_or(i32::MAX);
            let [first_share, second_share] = [beta1, beta2].map(|beta| 1.0 - beta.powi(exponent));
            // PyTorch's order: epsilon is added to the corrected root, so that it counts alike in every update.
            let root = second.clone().sqrt().div_scalar(second_share.sqrt());
            let direction = first.clone() / root.add_scalar(epsilon);
            let value =
                parameters.flat(&name)? - direction.mul_scalar(rate_of(&name) / first_share);
            parameters.set(&name, value)?;
            let kept = Moments {
                updates,
                first,
                second,
            };
            self.moments.insert(name, kept);
        }
        Ok(length)
    }
}
