//! The network of a [`NetSpec`] on burn tensors: the same computation as in `grimnet-net`, for batches and with gradients.
//!
//! Activations are NHWC. A batch holds pictures of both domains; only the normalisations treat the domains separately.

use crate::error::TrainError;
use crate::model::input::{Input, Part};
use crate::model::normalisation::{Statistics, norm_relu_by_domain};
use crate::model::parameters::Parameters;
use crate::model::resample::{coarse_mask, upsample_twice};
use crate::model::vlad::net_vlad;
use crate::ops::{conv3x3, transposed_conv4x4};
use burn::tensor::Tensor;
use burn::tensor::module::max_pool2d;
use burn::tensor::ops::MaxPoolOptions;
use grimnet_net::{Decoder, Downsample, KeypointHead, NetSpec, VladInput};

/// The outputs of the network for a batch.
#[derive(Clone, Debug)]
pub struct Output {
    /// `[n * cells, 65]`: logits of the 64 pixels of each cell and of "no keypoint".
    pub keypoints: Tensor<2>,
    /// `[n, h / 8, w / 8, d]`: local descriptors, not normalised.
    pub descriptors: Tensor<4>,
    /// `[n, h', w', d']`: the vectors that NetVLAD aggregates, not normalised; without gradient if the global descriptor
    /// has none.
    pub aggregated: Tensor<4>,
    /// `[n, k * d]`: global descriptors of unit length, not whitened.
    pub global: Tensor<2>,
}

/// A forward pass. Collects the updated running statistics with [`Statistics::Batch`].
pub struct Network<'a> {
    parameters: &'a Parameters,
    statistics: Statistics,
    running: Vec<(String, Tensor<1>)>,
}

impl<'a> Network<'a> {
    /// A forward pass with these parameters.
    pub fn new(parameters: &'a Parameters, statistics: Statistics) -> Self {
        Self {
            parameters,
            statistics,
            running: Vec::new(),
        }
    }

    /// The updated running statistics, to be stored with [`Parameters::set`]; empty with [`Statistics::Running`].
    pub fn into_running(self) -> Vec<(String, Tensor<1>)> {
        self.running
    }

    /// Runs the network. With `with_global` the gradient of the global descriptor reaches the layers below NetVLAD.
    ///
    /// # Errors
    /// Returns an error if the parameters do not fit their description.
    pub fn forward(&mut self, input: &Input, with_global: bool) -> Result<Output, TrainError> {
        let stages = self.encode(input)?;
        let features = self.decode(&stages, &input.parts)?;
        let descriptors = match self.spec().decoder {
            Decoder::Lateral { .. } => self.linear("descriptor", features.clone())?,
            Decoder::Transposed { .. } | Decoder::TransposedPlain { .. } => {
                self.conv_with_bias("descriptor", features.clone())?
            }
        };
        let keypoints = match self.spec().keypoints {
            KeypointHead::FromGrey { layers, .. } => self.keypoints_from_grey(input, layers)?,
            KeypointHead::FromDecoder => self.conv_with_bias("keypoint", features)?,
        };
        let [n, h, w, _] = keypoints.dims();
        let (vectors, seen) = match self.spec().vlad.input {
            VladInput::Descriptors => (descriptors.clone(), input.seen.clone()),
            VladInput::Deepest | VladInput::DeepestUnscaled => {
                (deepest(stages)?, coarse_mask(&input.seen, n, h, w))
            }
        };
        let vectors = if with_global {
            vectors
        } else {
            vectors.detach()
        };
        Ok(Output {
            keypoints: cells(keypoints),
            global: net_vlad(self.parameters, vectors.clone(), seen)?,
            aggregated: vectors,
            descriptors,
        })
    }

    /// The keypoint logits, as [`Output::keypoints`], without computing the other outputs.
    ///
    /// # Errors
    /// As [`Network::forward`].
    pub fn keypoints(&mut self, input: &Input) -> Result<Tensor<2>, TrainError> {
        let logits = match self.spec().keypoints {
            KeypointHead::FromGrey { layers, .. } => self.keypoints_from_grey(input, layers)?,
            KeypointHead::FromDecoder => {
                let stages = self.encode(input)?;
                let features = self.decode(&stages, &input.parts)?;
                self.conv_with_bias("keypoint", features)?
            }
        };
        Ok(cells(logits))
    }

    /// Scene logits `[n, scenes]`: a linear classifier on the mean of the deepest features (global average pooling; Lin,
    /// Chen and Yan 2014).
    ///
    /// # Errors
    /// As [`Network::forward`]; also if the parameters have no classifier.
    pub fn scenes(&mut self, input: &Input) -> Result<Tensor<2>, TrainError> {
        let features = deepest(self.encode(input)?)?;
        let [n, h, w, c] = features.dims();
        let pooled = features.reshape([n, h * w, c]).mean_dim(1).reshape([n, c]);
        let weight = self.parameters.shaped::<2>("classifier.weight")?;
        let bias = self.parameters.flat("classifier.bias")?;
        Ok(pooled.matmul(weight.transpose()) + bias.unsqueeze::<2>())
    }

    fn spec(&self) -> &'a NetSpec {
        self.parameters.spec()
    }

    /// The features after each stage, `[n, h / 2^(stage + 1), w / 2^(stage + 1), c]`.
    pub(crate) fn encode(&mut self, input: &Input) -> Result<Vec<Tensor<4>>, TrainError> {
        let mut x = input.pictures.clone();
        let mut stages = Vec::with_capacity(self.spec().stages.len());
        for (s, stage) in self.spec().stages.iter().enumerate() {
            for c in 0..stage.widths.len() {
                let stride = if c == 0 && stage.downsample == Downsample::StrideFirst {
                    2
                } else {
                    1
                };
                let name = format!("encoder.{s}.{c}");
                let y = conv3x3(
                    x,
                    self.parameters.shaped::<4>(&format!("{name}.weight"))?,
                    stride,
                );
                x = self.norm(&name, y, &input.parts)?;
            }
            if stage.downsample == Downsample::MaxPoolLast {
                let pooled = max_pool2d(x.permute([0, 3, 1, 2]), MaxPoolOptions::new([2, 2]));
                x = pooled.permute([0, 2, 3, 1]);
            }
            stages.push(x.clone());
        }
        Ok(stages)
    }

    /// The input of the keypoint and descriptor heads, `[n, h / 8, w / 8, c]`.
    fn decode(&mut self, stages: &[Tensor<4>], parts: &[Part]) -> Result<Tensor<4>, TrainError> {
        let [_, _, h8, h16, h32] = stages else {
            return Err(not_five_stages());
        };
        match self.spec().decoder {
            Decoder::Lateral { .. } => {
                let coarse = upsample_twice(self.linear("lateral.h32", h32.clone())?);
                let middle = upsample_twice(self.linear("lateral.h16", h16.clone())? + coarse);
                let weight = self.parameters.shaped::<4>("fuse.weight")?;
                let fused = conv3x3(h8.clone() + middle, weight, 1);
                self.norm("fuse", fused, parts)
            }
            Decoder::Transposed { .. } => {
                let mut x = h32.clone();
                for name in ["upsample.0", "upsample.1"] {
                    let y = self.transposed(name, x, None)?;
                    x = self.norm(name, y, parts)?;
                }
                Ok(x)
            }
            Decoder::TransposedPlain { .. } => {
                let mut x = h32.clone();
                for name in ["upsample.0", "upsample.1"] {
                    let bias = self.parameters.flat(&format!("{name}.bias"))?;
                    x = self.transposed(name, x, Some(bias))?;
                }
                Ok(x)
            }
        }
    }

    /// 4x4 transposed convolution, stride 2, padding 1.
    fn transposed(
        &self,
        name: &str,
        x: Tensor<4>,
        bias: Option<Tensor<1>>,
    ) -> Result<Tensor<4>, TrainError> {
        let weight = self.parameters.shaped::<4>(&format!("{name}.weight"))?;
        let y = transposed_conv4x4(x, weight);
        Ok(match bias {
            Some(bias) => y + bias.unsqueeze::<4>(),
            None => y,
        })
    }

    fn keypoints_from_grey(
        &mut self,
        input: &Input,
        layers: usize,
    ) -> Result<Tensor<4>, TrainError> {
        let mut x = input.grey_cells.clone();
        for i in 0..layers {
            let name = format!("keypoint.{i}");
            let y = self.product(&name, x)?;
            x = self.norm(&name, y, &input.parts)?;
        }
        self.linear("keypoint.out", x)
    }

    /// Batch normalisation and ReLU; collects the running statistics.
    fn norm(&mut self, name: &str, x: Tensor<4>, parts: &[Part]) -> Result<Tensor<4>, TrainError> {
        let (y, running) = norm_relu_by_domain(self.parameters, name, x, parts, self.statistics)?;
        self.running.extend(running);
        Ok(y)
    }

    /// 1x1 convolution without bias.
    fn product(&self, name: &str, x: Tensor<4>) -> Result<Tensor<4>, TrainError> {
        let weight = self.parameters.shaped::<4>(&format!("{name}.weight"))?;
        let ([n, h, w, c], [o, ..]) = (x.dims(), weight.dims());
        let y = x
            .reshape([n * h * w, c])
            .matmul(weight.reshape([o, c]).transpose());
        Ok(y.reshape([n, h, w, o]))
    }

    fn linear(&self, name: &str, x: Tensor<4>) -> Result<Tensor<4>, TrainError> {
        let bias = self.parameters.flat(&format!("{name}.bias"))?;
        Ok(self.product(name, x)? + bias.unsqueeze::<4>())
    }

    fn conv_with_bias(&self, name: &str, x: Tensor<4>) -> Result<Tensor<4>, TrainError> {
        let y = conv3x3(
            x,
            self.parameters.shaped::<4>(&format!("{name}.weight"))?,
            1,
        );
        Ok(y + self
            .parameters
            .flat(&format!("{name}.bias"))?
            .unsqueeze::<4>())
    }
}

fn not_five_stages() -> TrainError {
    TrainError::Config {
        reason: "the encoder must have five stages".into(),
    }
}

/// The features of the last stage.
fn deepest(mut stages: Vec<Tensor<4>>) -> Result<Tensor<4>, TrainError> {
    stages.pop().ok_or_else(not_five_stages)
}

/// `[n, h, w, c]` to `[n * h * w, c]`.
fn cells(x: Tensor<4>) -> Tensor<2> {
    let [n, h, w, c] = x.dims();
    x.reshape([n * h * w, c])
}
