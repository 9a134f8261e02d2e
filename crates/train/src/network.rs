//! The network of a [`NetSpec`] on burn tensors: what `grimnet-net` computes for one picture, for batches and with gradients.
//!
//! Activations are NHWC. A batch holds the pictures of both domains; convolutions see it whole, normalisations by domain.

use crate::TrainError;
use crate::ops::{Group, conv3x3, follow_moments, norm_relu};
use crate::parameters::Parameters;
use burn::tensor::activation::softmax;
use burn::tensor::module::{conv_transpose2d, max_pool2d};
use burn::tensor::ops::{ConvTransposeOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData};
use grimnet_net::{Decoder, Domain, Downsample, KeypointHead, NetSpec, VladInput};
use std::sync::Arc;

/// As in `grimnet-net` (paper, eq. 3).
const NORM_EPSILON: f32 = 1e-5;
/// Kept away from zero when a vector is brought to unit length.
const LENGTH_EPSILON: f32 = 1e-12;

/// Pictures that follow each other in a batch and belong to one domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Number of pictures.
    pub pictures: usize,
    /// Their domain.
    pub domain: Domain,
}

/// Whose statistics normalise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Statistics {
    /// The batch's, per domain; the running ones follow.
    Batch,
    /// The running ones, which the model file holds.
    Running,
}

/// A batch as the network takes it.
#[derive(Clone, Debug)]
pub struct Input {
    /// `[n, h, w, 3]`, normalised by the spec's mean and deviation; sides multiples of 32.
    pub pictures: Tensor<4>,
    /// `[n, h / 8, w / 8, 64]`: the channel mean, each 8 x 8 cell in raster order.
    pub grey_cells: Tensor<4>,
    /// `[n, (h / 8) * (w / 8), 1]`: 1 where a cell was seen, 0 where it lies outside the picture.
    pub seen: Tensor<3>,
    /// The batch's parts, in order; their pictures add up to n.
    pub parts: Vec<Part>,
}

/// What the network makes of a batch.
#[derive(Clone, Debug)]
pub struct Output {
    /// `[n * cells, 65]`: logits of the 64 places of each cell and of "none".
    pub keypoints: Tensor<2>,
    /// `[n, h / 8, w / 8, d]`, not normalised.
    pub descriptors: Tensor<4>,
    /// `[n, h', w', d']`: what NetVLAD aggregates, not normalised; no gradient where none is to reach it.
    pub aggregated: Tensor<4>,
    /// `[n, k * d]`, unit length, not whitened.
    pub global: Tensor<2>,
}

/// One forward pass. Holds the parameters to read and, with [`Statistics::Batch`], those whose running statistics follow.
pub struct Network<'a> {
    parameters: &'a Parameters,
    statistics: Statistics,
    running: Vec<(String, Tensor<1>)>,
}

impl<'a> Network<'a> {
    /// A pass with these parameters.
    pub fn new(parameters: &'a Parameters, statistics: Statistics) -> Self {
        Self {
            parameters,
            statistics,
            running: Vec::new(),
        }
    }

    /// The running statistics after the pass, to be set by [`Parameters::set`]; empty with [`Statistics::Running`].
    pub fn into_running(self) -> Vec<(String, Tensor<1>)> {
        self.running
    }

    /// Runs the network; `with_global` says whether the global descriptor's gradient reaches the layers below NetVLAD.
    ///
    /// # Errors
    /// Where the parameters are not those of their spec.
    pub fn forward(&mut self, input: &Input, with_global: bool) -> Result<Output, TrainError> {
        let stages = self.encode(input)?;
        let features = self.decode(&stages, &input.parts)?;
        let descriptors = match self.spec().decoder {
            Decoder::Lateral { .. } => self.linear("descriptor", features.clone())?,
            Decoder::Transposed { .. } => self.conv_with_bias("descriptor", features.clone())?,
        };
        let keypoints = match self.spec().keypoints {
            KeypointHead::FromGrey { layers, .. } => self.keypoints_from_grey(input, layers)?,
            KeypointHead::FromDecoder => self.conv_with_bias("keypoint", features)?,
        };
        let [n, h, w, _] = keypoints.dims();
        let (vectors, seen) = match self.spec().vlad.input {
            VladInput::Descriptors => (descriptors.clone(), input.seen.clone()),
            VladInput::Deepest => (deepest(stages)?, coarse_seen(&input.seen, n, h, w)),
        };
        let vectors = if with_global {
            vectors
        } else {
            vectors.detach()
        };
        Ok(Output {
            keypoints: cells(keypoints),
            global: self.vlad(vectors.clone(), seen)?,
            aggregated: vectors,
            descriptors,
        })
    }

    /// The keypoint logits alone, as [`Output::keypoints`]: only what they need is computed.
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
    /// As [`Network::forward`]; where the parameters have no classifier.
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

    /// What keypoints and descriptors are made from, `[n, h / 8, w / 8, c]`.
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
                    let weight = self.parameters.shaped::<4>(&format!("{name}.weight"))?;
                    let options = ConvTransposeOptions::new([2, 2], [1, 1], [0, 0], [1, 1], 1);
                    let y = conv_transpose2d(x.permute([0, 3, 1, 2]), weight, None, options);
                    x = self.norm(name, y.permute([0, 2, 3, 1]), parts)?;
                }
                Ok(x)
            }
        }
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

    /// DA-BN and ReLU.
    fn norm(&mut self, name: &str, x: Tensor<4>, parts: &[Part]) -> Result<Tensor<4>, TrainError> {
        let [n, h, w, c] = x.dims();
        let of = |domain: Domain, part: &str| self.parameters.flat(&domain.norm_name(name, part));
        let both = |part: &str| -> Result<Tensor<2>, TrainError> {
            Ok(Tensor::stack(
                vec![of(Domain::Sat, part)?, of(Domain::Uav, part)?],
                0,
            ))
        };
        let (gamma, beta) = (both("weight")?, both("bias")?);
        let rows = x.reshape([n * h * w, c]);
        let index = |domain: Domain| usize::from(domain == Domain::Uav);
        if self.statistics == Statistics::Running {
            let (mean, variance) = (both("mean")?, both("var")?);
            let scale = gamma / variance.add_scalar(NORM_EPSILON).sqrt();
            let shift = beta - mean * scale.clone();
            let (mut out, mut start) = (Vec::new(), 0);
            for part in parts {
                let count = part.pictures * h * w;
                let row = index(part.domain);
                let y = rows.clone().narrow(0, start, count) * scale.clone().narrow(0, row, 1)
                    + shift.clone().narrow(0, row, 1);
                out.push(y.clamp_min(0.0));
                start += count;
            }
            return Ok(Tensor::cat(out, 0).reshape([n, h, w, c]));
        }
        let groups = parts
            .iter()
            .map(|part| Group {
                rows: part.pictures * h * w,
                domain: index(part.domain),
            })
            .collect();
        let (y, mean, variance) = norm_relu(rows, gamma, beta, &Arc::new(groups), NORM_EPSILON);
        for (g, part) in parts.iter().enumerate() {
            let name = |what: &str| part.domain.norm_name(name, what);
            let row = |found: &Tensor<2>| found.clone().narrow(0, g, 1).reshape([c]);
            let old = |what: &str| {
                Ok::<_, TrainError>(self.parameters.flat(&name(what))?.without_autodiff())
            };
            let followed = follow_moments(
                [old("mean")?, old("var")?],
                [row(&mean), row(&variance)],
                part.pictures * h * w,
            );
            for (what, value) in ["mean", "var"].into_iter().zip(followed) {
                self.running.push((name(what), value));
            }
        }
        Ok(y.reshape([n, h, w, c]))
    }

    /// NetVLAD (paper, eq. 5-7) on unit vectors; cells that were not seen do not count.
    fn vlad(&self, x: Tensor<4>, seen: Tensor<3>) -> Result<Tensor<2>, TrainError> {
        let [n, h, w, d] = x.dims();
        let unit = unit_rows(x.reshape([n * h * w, d]));
        let weight = self.parameters.shaped::<2>("netvlad.assign.weight")?;
        let bias = self.parameters.flat("netvlad.assign.bias")?;
        let centres = self.parameters.shaped::<2>("netvlad.centres")?;
        let k = weight.dims()[0];
        let logits = unit.clone().matmul(weight.transpose()) + bias.unsqueeze::<2>();
        let share = softmax(logits, 1).reshape([n, h * w, k]) * seen;
        let sums = share
            .clone()
            .swap_dims(1, 2)
            .matmul(unit.reshape([n, h * w, d]));
        let mass = share.sum_dim(1).swap_dims(1, 2);
        let residuals = sums - mass * centres.unsqueeze::<3>();
        let rows = unit_rows(residuals.reshape([n * k, d])).reshape([n, k * d]);
        Ok(unit_rows(rows))
    }
}

fn not_five_stages() -> TrainError {
    TrainError::Config {
        reason: "the encoder has not five stages".into(),
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

/// Each row to unit length.
pub(crate) fn unit_rows(x: Tensor<2>) -> Tensor<2> {
    let length = x
        .clone()
        .square()
        .sum_dim(1)
        .add_scalar(LENGTH_EPSILON)
        .sqrt();
    x / length
}

/// A deep cell counts where any of its cells was seen.
fn coarse_seen(seen: &Tensor<3>, n: usize, h: usize, w: usize) -> Tensor<3> {
    let grid = seen.clone().reshape([n, 1, h, w]);
    max_pool2d(grid, MaxPoolOptions::new([4, 4])).reshape([n, (h / 4) * (w / 4), 1])
}

/// Bilinear weights from `from` samples to twice as many, half-pixel centres, edges repeated (`align_corners = false`).
fn doubling(from: usize) -> Vec<f32> {
    let mut matrix = vec![0.0; 2 * from * from];
    for to in 0..2 * from {
        let at = (to as f32 + 0.5) / 2.0 - 0.5;
        let low = at.floor();
        let share = at - low;
        let clamp = |i: f32| (i.max(0.0) as usize).min(from - 1);
        matrix[to * from + clamp(low)] += 1.0 - share;
        matrix[to * from + clamp(low + 1.0)] += share;
    }
    matrix
}

/// `[n, h, w, c]` to `[n, 2h, 2w, c]`, bilinear.
fn upsample_twice(x: Tensor<4>) -> Tensor<4> {
    let [n, h, w, c] = x.dims();
    let device = x.device().without_autodiff();
    let constant = |side: usize, device: &Device| {
        let matrix =
            Tensor::<2>::from_data(TensorData::new(doubling(side), [2 * side, side]), device);
        matrix.autodiff_as(x.is_autodiff())
    };
    let tall = constant(h, &device)
        .unsqueeze::<3>()
        .expand([n, 2 * h, h])
        .matmul(x.clone().reshape([n, h, w * c]));
    // Columns: one product over [rows, w, c] with the row axis as batch.
    let rows = n * 2 * h;
    let wide = constant(w, &device)
        .unsqueeze::<3>()
        .expand([rows, 2 * w, w])
        .matmul(tall.reshape([rows, w, c]));
    wide.reshape([n, 2 * h, 2 * w, c])
}

trait AutodiffAs {
    /// The tensor as a constant of the graph, where there is one.
    fn autodiff_as(self, autodiff: bool) -> Self;
}

impl AutodiffAs for Tensor<2> {
    fn autodiff_as(self, autodiff: bool) -> Self {
        if autodiff { self.autodiff() } else { self }
    }
}
