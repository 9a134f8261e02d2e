//! A convolution with its normalisation, which is folded into the weights or computed from the image itself.

use grimnet_kernels::{
    Activation, Conv2d, ConvSpec, ConvTranspose2d, Isa, Tensor, Workspace, channel_moments,
    scale_shift,
};

use crate::error::{ParameterError, StatisticsError};
use crate::seen::Seen;
use crate::spec::BATCH_NORM_EPSILON;
use crate::{Domain, LayerStatistics, Model, NetError, Statistics};

/// What the layers of a network are built from.
#[derive(Clone, Copy)]
pub(crate) struct LayerSource<'a> {
    pub isa: Isa,
    pub model: &'a Model,
    pub domain: Domain,
    /// Those of all layers, for this domain.
    pub statistics: &'a Statistics,
    /// Whether layers normalise with the image's own moments instead.
    pub instance: bool,
}

impl<'a> LayerSource<'a> {
    /// The affine parameters and the statistics of a layer's normalisation.
    pub(crate) fn norm(
        &self,
        name: &str,
    ) -> Result<(Vec<f32>, Vec<f32>, &'a LayerStatistics), NetError> {
        let part = |part: &str| self.model.values(&self.domain.norm_name(name, part));
        let missing = || NetError::Statistics(StatisticsError::OtherModel);
        let moments = self
            .statistics
            .layers()
            .iter()
            .find(|layer| layer.name == name)
            .ok_or_else(missing)?;
        Ok((part("weight")?, part("bias")?, moments))
    }

    /// The weights and the bias of a convolution with its normalisation folded in.
    pub(crate) fn folded(&self, name: &str, kind: Kind) -> Result<(Vec<f32>, Vec<f32>), NetError> {
        let (weight, bias, moments) = self.norm(name)?;
        let (scale, shift) = affine(&weight, &bias, &moments.mean, &moments.var);
        let mut kernel = self.model.values(&format!("{name}.weight"))?;
        let shape = shape(self.model, name)?;
        match kind {
            Kind::Conv { .. } => {
                let per_output: usize = shape[1..].iter().product();
                kernel
                    .chunks_exact_mut(per_output)
                    .zip(&scale)
                    .for_each(|(row, s)| row.iter_mut().for_each(|w| *w *= s));
            }
            Kind::Transposed => {
                let taps: usize = shape[2..].iter().product();
                let outputs = scale.iter().cycle();
                kernel
                    .chunks_exact_mut(taps)
                    .zip(outputs)
                    .for_each(|(row, s)| row.iter_mut().for_each(|w| *w *= s));
            }
        }
        Ok((kernel, shift))
    }
}

/// The kind of a layer's convolution.
#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Conv {
        kernel: usize,
        stride: usize,
    },
    /// 4 x 4, stride 2, padding 1.
    Transposed,
}

enum Convolution {
    Plain(Conv2d),
    Transposed(ConvTranspose2d),
}

/// Normalisation that is not folded: affine parameters, and stored moments for the case that no position is visible.
struct InstanceNorm {
    weight: Vec<f32>,
    bias: Vec<f32>,
    stored: LayerStatistics,
}

pub(crate) struct Layer {
    convolution: Convolution,
    instance: Option<InstanceNorm>,
}

/// Input and results of layers that normalise with the image's own moments.
#[derive(Default)]
pub(crate) struct Gathering<'a> {
    pub seen: Option<&'a Seen>,
    pub layers: Vec<LayerStatistics>,
}

impl Layer {
    /// Convolution, DA-BN, ReLU.
    pub(crate) fn normalised(
        source: &LayerSource,
        name: &str,
        kind: Kind,
    ) -> Result<Self, NetError> {
        let &LayerSource {
            isa,
            model,
            instance,
            ..
        } = source;
        let (weight, bias, moments) = source.norm(name)?;
        if instance {
            let kernel = model.values(&format!("{name}.weight"))?;
            let convolution = Convolution::new(
                isa,
                model,
                name,
                kind,
                &kernel,
                &vec![0.0; bias.len()],
                Activation::Identity,
            )?;
            return Ok(Self {
                convolution,
                instance: Some(InstanceNorm {
                    weight,
                    bias,
                    stored: moments.clone(),
                }),
            });
        }
        let (kernel, shift) = source.folded(name, kind)?;
        let convolution =
            Convolution::new(isa, model, name, kind, &kernel, &shift, Activation::Relu)?;
        Ok(Self {
            convolution,
            instance: None,
        })
    }

    /// Convolution and bias only.
    pub(crate) fn plain(source: &LayerSource, name: &str, kind: Kind) -> Result<Self, NetError> {
        let &LayerSource { isa, model, .. } = source;
        let (kernel, bias) = (
            model.values(&format!("{name}.weight"))?,
            model.values(&format!("{name}.bias"))?,
        );
        Ok(Self {
            convolution: Convolution::new(
                isa,
                model,
                name,
                kind,
                &kernel,
                &bias,
                Activation::Identity,
            )?,
            instance: None,
        })
    }

    /// A matrix product at each position.
    pub(crate) fn product(source: &LayerSource, name: &str) -> Result<Self, NetError> {
        let &LayerSource { isa, model, .. } = source;
        let (kernel, kind) = (
            model.values(&format!("{name}.weight"))?,
            Kind::Conv {
                kernel: 1,
                stride: 1,
            },
        );
        let bias = vec![0.0; shape(model, name)?[0]];
        Ok(Self {
            convolution: Convolution::new(
                isa,
                model,
                name,
                kind,
                &kernel,
                &bias,
                Activation::Identity,
            )?,
            instance: None,
        })
    }

    /// Runs the layer; `output` is reshaped.
    pub(crate) fn forward(
        &self,
        isa: Isa,
        input: &Tensor,
        output: &mut Tensor,
        workspace: &mut Workspace,
        gathering: &mut Gathering,
    ) {
        match &self.convolution {
            Convolution::Plain(conv) => conv.forward(input, output, workspace),
            Convolution::Transposed(conv) => conv.forward(input, output, workspace),
        }
        if let Some(norm) = &self.instance {
            let mask = gathering.seen.map(|seen| seen.at_height(output.height()));
            let moments = match mask {
                None => Some(channel_moments(isa, output, None)),
                Some(Some(mask)) => Some(channel_moments(isa, output, Some(mask))),
                Some(None) => None,
            };
            let name = norm.stored.name.clone();
            let layer = moments.map_or_else(
                || norm.stored.clone(),
                |(mean, var)| LayerStatistics { name, mean, var },
            );
            let (scale, shift) = affine(&norm.weight, &norm.bias, &layer.mean, &layer.var);
            scale_shift(isa, output, &scale, &shift, Activation::Relu);
            gathering.layers.push(layer);
        }
    }
}

impl Convolution {
    fn new(
        isa: Isa,
        model: &Model,
        name: &str,
        kind: Kind,
        weight: &[f32],
        bias: &[f32],
        activation: Activation,
    ) -> Result<Self, NetError> {
        let shape = shape(model, name)?;
        Ok(match kind {
            Kind::Conv { kernel, stride } => {
                let spec = ConvSpec {
                    in_channels: shape[1],
                    out_channels: shape[0],
                    kernel,
                    stride,
                };
                Self::Plain(Conv2d::new(isa, spec, weight, bias, activation)?)
            }
            Kind::Transposed => Self::Transposed(ConvTranspose2d::new(
                isa, shape[0], shape[1], weight, bias, activation,
            )?),
        })
    }
}

/// Shape of a layer's weight: four sizes, or K x D for NetVLAD's assignment, which is a 1 x 1 convolution.
pub(crate) fn shape(model: &Model, name: &str) -> Result<[usize; 4], NetError> {
    let shape = model
        .parameter(&format!("{name}.weight"))
        .map(|parameter| parameter.shape());
    match shape {
        Some(&[out, input, rows, columns]) => Ok([out, input, rows, columns]),
        Some(&[out, input]) => Ok([out, input, 1, 1]),
        _ => Err(NetError::Parameters(ParameterError::Missing(format!(
            "{name}.weight"
        )))),
    }
}

/// gamma (x - mean) / sqrt(var + eps) + beta as x * scale + shift (paper, eq. 3).
fn affine(weight: &[f32], bias: &[f32], mean: &[f32], var: &[f32]) -> (Vec<f32>, Vec<f32>) {
    let scale: Vec<f32> = weight
        .iter()
        .zip(var)
        .map(|(w, v)| w / (v + BATCH_NORM_EPSILON).sqrt())
        .collect();
    let shift = bias
        .iter()
        .zip(mean)
        .zip(&scale)
        .map(|((b, m), s)| b - m * s)
        .collect();
    (scale, shift)
}
