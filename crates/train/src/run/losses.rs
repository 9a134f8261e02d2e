//! The values of the losses.

/// The losses of a step, or of several steps the mean of those that computed it; `None` for losses that were not computed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Losses {
    /// Keypoint cross-entropy.
    pub keypoint: Option<f32>,
    /// Loss of local descriptors.
    pub descriptor: Option<f32>,
    /// Loss of global descriptors.
    pub global: Option<f32>,
    /// Homography reprojection, in units of `homography.unit_px`.
    pub homography: Option<f32>,
    /// Distillation of the teacher's keypoint probabilities.
    pub taught_keypoint: Option<f32>,
    /// Distillation of the teacher's local descriptors: 1 - cosine.
    pub taught_descriptor: Option<f32>,
    /// Distillation of the teacher's similarities of global descriptors.
    pub taught_global: Option<f32>,
    /// Cross-entropy over scene classes.
    pub scene: Option<f32>,
}

impl Losses {
    /// Names and values.
    pub fn terms(&self) -> [(&'static str, Option<f32>); 8] {
        [
            ("keypoint loss", self.keypoint),
            ("descriptor loss", self.descriptor),
            ("global loss", self.global),
            ("homography loss", self.homography),
            ("taught keypoint loss", self.taught_keypoint),
            ("taught descriptor loss", self.taught_descriptor),
            ("taught global loss", self.taught_global),
            ("scene loss", self.scene),
        ]
    }

    fn slots(&mut self) -> [&mut Option<f32>; 8] {
        [
            &mut self.keypoint,
            &mut self.descriptor,
            &mut self.global,
            &mut self.homography,
            &mut self.taught_keypoint,
            &mut self.taught_descriptor,
            &mut self.taught_global,
            &mut self.scene,
        ]
    }
}

/// Sums of the losses of several steps, each over the steps that computed it: by turns a step computes those of one task only.
#[derive(Default)]
pub(crate) struct LossSums([(f32, u32); 8]);

impl LossSums {
    /// Adds the losses of a step.
    pub fn add(&mut self, losses: &Losses) {
        for ((sum, steps), (_, value)) in self.0.iter_mut().zip(losses.terms()) {
            if let Some(value) = value {
                *sum += value;
                *steps += 1;
            }
        }
    }

    /// The mean of each loss.
    pub fn mean(&self) -> Losses {
        let mut mean = Losses::default();
        for (slot, &(sum, steps)) in mean.slots().into_iter().zip(&self.0) {
            *slot = (steps > 0).then(|| sum / steps as f32);
        }
        mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_is_over_the_steps_that_computed_the_loss() {
        let mut sums = LossSums::default();
        for (keypoint, global) in [(Some(4.5), None), (None, Some(0.0)), (Some(5.0), None)] {
            sums.add(&Losses {
                keypoint,
                global,
                ..Losses::default()
            });
        }
        let expected = Losses {
            keypoint: Some(4.75),
            global: Some(0.0),
            ..Losses::default()
        };
        assert_eq!(sums.mean(), expected);
    }
}
