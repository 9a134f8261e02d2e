//! The total loss of a step (paper, eq. 25).

use super::batch_targets::{
    cell_weights, correspondences_of, labels_of, points_of, same_places, scenes_of, seen_of,
};
use super::losses::Losses;
use super::memory::{Memory, overlaps_within};
use crate::config::{DescriptorLoss, GlobalLoss, Stage, TrainConfig};
use crate::data::{Batch, Task};
use crate::error::TrainError;
use crate::loss::{
    descriptor_contrast, descriptor_distillation, descriptor_hinge, global_contrast,
    homography_reprojection, keypoint_cross_entropy, keypoint_distillation, multi_similarity,
    sample_descriptors, scene_cross_entropy, similarity_distillation, triplet,
};
use crate::model::input::Input;
use crate::model::network::{Network, Output};
use crate::model::parameters::host;
use crate::model::teacher::Teacher;
use burn::tensor::{Device, Tensor};
use grimnet_net::NetSpec;

/// The tasks that a step trains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Tasks {
    /// Encoder and NetVLAD.
    pub retrieval: bool,
    /// Encoder and decoders.
    pub matching: bool,
}

impl Tasks {
    /// The tasks of a step. Retrieval is not trained before NetVLAD is initialised.
    pub fn of(config: &TrainConfig, step: u64, centres_started: bool) -> Self {
        // By turns also where a task has no weight: a network that is trained for one task alone makes as many steps for it then as one
        // that is trained for both. The other steps change no parameter ([`Sum::add`]) and no statistics.
        if config.alternate && centres_started {
            let task = Task::of_step(step);
            return Self {
                retrieval: task == Task::Retrieval,
                matching: task == Task::Matching,
            };
        }
        Self {
            retrieval: centres_started && config.trains_global_descriptor(),
            matching: true,
        }
    }
}

/// Computes the losses of a configuration.
pub(crate) struct Objective {
    config: TrainConfig,
    memory: Memory,
    teacher: Option<Teacher>,
}

/// A weighted sum of losses.
#[derive(Default)]
struct Sum {
    total: Option<Tensor<1>>,
}

impl Sum {
    /// Adds a loss and returns its value. One without weight adds nothing, not a gradient of 0: where Adam gets one in every other step,
    /// its first moment goes on moving the parameters and its second is half as large, so that it takes steps 1.4 times as long.
    fn add(&mut self, loss: Tensor<1>, weight: f32) -> Result<f32, TrainError> {
        let value = host(loss.clone().without_autodiff())?;
        if weight == 0.0 {
            return Ok(value.first().copied().unwrap_or(0.0));
        }
        let weighted = loss.mul_scalar(weight);
        self.total = Some(match self.total.take() {
            Some(total) => total + weighted,
            None => weighted,
        });
        Ok(value.first().copied().unwrap_or(0.0))
    }
}

impl Objective {
    /// The losses for a network of description `student`.
    ///
    /// # Errors
    /// Returns an error if the teacher cannot be opened or does not fit the network.
    pub fn new(
        config: &TrainConfig,
        student: &NetSpec,
        device: &Device,
    ) -> Result<Self, TrainError> {
        let teacher = match &config.teacher {
            Some(options) => Some(Teacher::open(options, student, device)?),
            None => None,
        };
        Ok(Self {
            config: config.clone(),
            memory: Memory::new(config.memory_batches),
            teacher,
        })
    }

    /// Runs the parts of the network that the stage trains. Returns the total loss, if a loss of these tasks has a weight, and the value
    /// of each term.
    ///
    /// # Errors
    /// Returns an error if values cannot be read from the device.
    pub fn compute(
        &mut self,
        network: &mut Network<'_>,
        input: &Input,
        batch: &Batch,
        tasks: Tasks,
    ) -> Result<(Option<Tensor<1>>, Losses), TrainError> {
        let (mut sum, mut losses) = (Sum::default(), Losses::default());
        match self.config.stage {
            Stage::Shapes => {
                let logits = network.keypoints(input)?;
                self.add_keypoints(logits, batch, &mut sum, &mut losses)?;
            }
            Stage::Scenes => {
                let loss = scene_cross_entropy(network.scenes(input)?, &scenes_of(batch));
                losses.scene = Some(sum.add(loss, 1.0)?);
            }
            Stage::Joint => {
                let output = network.forward(input, tasks.retrieval)?;
                self.add_joint(output, batch, tasks, &mut sum, &mut losses)?;
            }
        }
        Ok((sum.total, losses))
    }

    fn add_joint(
        &mut self,
        output: Output,
        batch: &Batch,
        tasks: Tasks,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        if tasks.matching {
            self.add_matching(&output, batch, sum, losses)?;
        }
        if self.teacher.is_some() {
            self.add_teacher(&output, batch, tasks, sum, losses)?;
        }
        if tasks.retrieval {
            self.add_retrieval(output, batch, sum, losses)?;
        }
        Ok(())
    }

    fn add_keypoints(
        &self,
        logits: Tensor<2>,
        batch: &Batch,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let weights = &self.config.weights;
        let labels = labels_of(batch);
        let shares = cell_weights(batch, &labels, weights.dustbin);
        let loss = keypoint_cross_entropy(logits, &labels, &shares);
        losses.keypoint = Some(sum.add(loss, weights.keypoint)?);
        Ok(())
    }

    fn add_matching(
        &self,
        output: &Output,
        batch: &Batch,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let weights = &self.config.weights;
        self.add_keypoints(output.keypoints.clone(), batch, sum, losses)?;
        let points = points_of(batch);
        let (n, half) = (batch.len(), points.len() / 2);
        let sampled = sample_descriptors(output.descriptors.clone(), &points);
        let sat = sampled.clone().narrow(0, 0, half);
        let uav = sampled.narrow(0, half, half);
        if weights.homography > 0.0 {
            let places = correspondences_of(batch, &output.descriptors.device());
            let options = &self.config.homography;
            let loss = homography_reprojection(sat.clone(), uav.clone(), &places, options);
            losses.homography = Some(sum.add(loss, weights.homography)?);
        }
        let descriptor = match self.config.descriptor_loss {
            DescriptorLoss::Contrast => {
                descriptor_contrast(sat, uav, n, self.config.descriptor_temperature)
            }
            DescriptorLoss::Hinge => {
                descriptor_hinge(sat, uav, n, &same_places(batch), &self.config.hinge)
            }
        };
        losses.descriptor = Some(sum.add(descriptor, weights.descriptor)?);
        Ok(())
    }

    fn add_retrieval(
        &mut self,
        output: Output,
        batch: &Batch,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let n = batch.len();
        let sat = output.global.clone().narrow(0, 0, n);
        let uav = output.global.narrow(0, n, n);
        let config = &self.config;
        let loss = match config.global_loss {
            GlobalLoss::Contrast => {
                let (past, excluded) = (self.memory.rows(), self.memory.excluded(batch));
                let loss =
                    global_contrast(sat.clone(), uav, past, &excluded, config.global_temperature);
                self.memory.push(sat, batch);
                loss
            }
            GlobalLoss::Triplet => triplet(sat, uav, &overlaps_within(batch), &config.triplet),
            GlobalLoss::MultiSimilarity => {
                let excluded = overlaps_within(batch);
                multi_similarity(sat, uav, &excluded, &config.multi_similarity)
            }
        };
        losses.global = Some(sum.add(loss, config.weights.global)?);
        Ok(())
    }

    fn add_teacher(
        &self,
        output: &Output,
        batch: &Batch,
        tasks: Tasks,
        sum: &mut Sum,
        losses: &mut Losses,
    ) -> Result<(), TrainError> {
        let (Some(teacher), Some(weights)) = (&self.teacher, &self.config.teacher) else {
            return Ok(());
        };
        let targets = teacher.targets(batch)?;
        let seen: Vec<f32> = seen_of(batch)
            .map(|seen| f32::from(u8::from(seen)))
            .collect();
        let keypoint = keypoint_distillation(output.keypoints.clone(), targets.keypoints, &seen);
        losses.taught_keypoint = Some(sum.add(keypoint, weights.keypoint)?);
        let [n, h, w, d] = output.descriptors.dims();
        let student = output.descriptors.clone().reshape([n * h * w, d]);
        let descriptor = descriptor_distillation(student, targets.descriptors, &seen);
        losses.taught_descriptor = Some(sum.add(descriptor, weights.descriptor)?);
        if tasks.retrieval {
            let global = similarity_distillation(output.global.clone(), targets.global);
            losses.taught_global = Some(sum.add(global, weights.global)?);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Weights;
    use crate::loss::constant;
    use crate::model::teacher::TeacherOptions;

    #[test]
    fn retrieval_is_trained_by_a_weight_or_by_a_teacher() {
        for (weight, taught, is_trained) in [
            (0.5, None, true),
            (0.0, None, false),
            (0.0, Some(0.0), false),
            (0.0, Some(1.0), true),
        ] {
            let config = TrainConfig {
                weights: Weights {
                    global: weight,
                    ..Weights::default()
                },
                teacher: taught.map(|global| TeacherOptions {
                    global,
                    ..TeacherOptions::default()
                }),
                ..TrainConfig::default()
            };
            assert_eq!(Tasks::of(&config, 0, true).retrieval, is_trained);
            assert!(!Tasks::of(&config, 0, false).retrieval, "before k-means");
        }
    }

    #[test]
    fn a_loss_without_weight_has_a_value_and_no_part_in_the_total() {
        let device = Device::flex();
        let loss = |value: f32| constant(vec![value], [1], &device);
        let mut sum = Sum::default();
        assert_eq!(sum.add(loss(3.0), 0.0).unwrap(), 3.0);
        assert!(sum.total.is_none());
        sum.add(loss(2.0), 0.5).unwrap();
        assert_eq!(host(sum.total.unwrap()).unwrap(), [1.0]);
    }
}
