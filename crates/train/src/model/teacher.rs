//! Knowledge distillation (Hinton, Vinyals and Dean 2015): a trained network whose outputs are targets of another. It trains
//! a deep encoder from random weights, where the contrastive losses alone make no progress.

use crate::data::Batch;
use crate::error::TrainError;
use crate::model::input::{Norms, input_of};
use crate::model::network::Network;
use crate::model::normalisation::Statistics;
use crate::model::parameters::Parameters;
use crate::model::vlad::unit_rows;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};
use grimnet_net::{Model, NetSpec};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The teacher and the weights of its losses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TeacherOptions {
    /// The teacher's model file; the bundled model if absent.
    pub model: Option<PathBuf>,
    /// Weight of the loss of keypoint probabilities.
    pub keypoint: f32,
    /// Weight of the loss of local descriptors.
    pub descriptor: f32,
    /// Weight of the loss of similarities of global descriptors.
    pub global: f32,
}

impl Default for TeacherOptions {
    fn default() -> Self {
        Self {
            model: None,
            keypoint: 1.0,
            descriptor: 5.0,
            global: 1.0,
        }
    }
}

/// A network whose parameters do not change.
pub(crate) struct Teacher {
    parameters: Parameters,
    device: Device,
}

/// The teacher's outputs for a batch, without gradient. Cells are in the order of the network's output.
pub(crate) struct Targets {
    /// `[cells, 65]`: probabilities of the keypoint classes.
    pub keypoints: Tensor<2>,
    /// `[cells, d]`, unit rows.
    pub descriptors: Tensor<2>,
    /// `[n, k * d]`, unit rows.
    pub global: Tensor<2>,
}

impl Teacher {
    /// Opens the model.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or the teacher's descriptors have more values than the student's.
    pub fn open(
        options: &TeacherOptions,
        student: &NetSpec,
        device: &Device,
    ) -> Result<Self, TrainError> {
        let model = match &options.model {
            Some(path) => Model::open(path)?,
            None => Model::bundled()?,
        };
        let (theirs, ours) = (model.spec().descriptor_dim, student.descriptor_dim);
        if theirs > ours {
            return Err(TrainError::Config {
                reason: format!(
                    "the teacher's descriptors have {theirs} values, more than the network's {ours}; set `teacher.model` to a model with at most {ours}"
                ),
            });
        }
        let device = device.clone().without_autodiff();
        Ok(Self {
            parameters: Parameters::of_model(&model, &device),
            device,
        })
    }

    /// Its outputs for a batch of pairs.
    ///
    /// # Errors
    /// Returns an error if the network cannot process the pictures.
    pub fn targets(&self, batch: &Batch) -> Result<Targets, TrainError> {
        let input = input_of(batch, self.parameters.spec(), Norms::ByDomain, &self.device);
        let output = Network::new(&self.parameters, Statistics::Running).forward(&input, false)?;
        let [n, h, w, d] = output.descriptors.dims();
        let descriptors = unit_rows(output.descriptors.reshape([n * h * w, d]));
        Ok(Targets {
            keypoints: softmax(output.keypoints, 1).autodiff(),
            descriptors: descriptors.autodiff(),
            global: output.global.autodiff(),
        })
    }
}
