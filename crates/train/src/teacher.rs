//! A trained network that shows another what to see (Hinton et al. 2015): what moves a deep encoder that starts from random
//! numbers, where contrast alone stands still.

use crate::TrainError;
use crate::batch::{Norms, input_of};
use crate::data::Batch;
use crate::network::{Network, Statistics, unit_rows};
use crate::parameters::Parameters;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};
use grimnet_net::{Model, NetSpec};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Who teaches, and how much it counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TeacherOptions {
    /// The teacher's model file; the bundled model where absent.
    pub model: Option<PathBuf>,
    /// Weight of the keypoint probabilities.
    pub keypoint: f32,
    /// Weight of the local descriptors.
    pub descriptor: f32,
    /// Weight of the similarities of global descriptors.
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

/// A network that is only read.
pub(crate) struct Teacher {
    parameters: Parameters,
    device: Device,
}

/// What the teacher sees in a batch; constants of the student's graph. Cells in the order of the network's output.
pub(crate) struct Lesson {
    /// `[cells, 65]`: probabilities of the places of a keypoint.
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
    /// Where the file cannot be read, or its descriptors are longer than the student's.
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
                    "the teacher's descriptors have {theirs} values, more than the network's {ours}; take another `teacher.model`"
                ),
            });
        }
        let device = device.clone().without_autodiff();
        Ok(Self {
            parameters: Parameters::of_model(&model, &device),
            device,
        })
    }

    /// What it sees in a batch of pairs.
    ///
    /// # Errors
    /// Where the network refuses the pictures.
    pub fn lesson(&self, batch: &Batch) -> Result<Lesson, TrainError> {
        let input = input_of(batch, self.parameters.spec(), Norms::ByDomain, &self.device);
        let output = Network::new(&self.parameters, Statistics::Running).forward(&input, false)?;
        let [n, h, w, d] = output.descriptors.dims();
        let descriptors = unit_rows(output.descriptors.reshape([n * h * w, d]));
        Ok(Lesson {
            keypoints: softmax(output.keypoints, 1).autodiff(),
            descriptors: descriptors.autodiff(),
            global: output.global.autodiff(),
        })
    }
}
