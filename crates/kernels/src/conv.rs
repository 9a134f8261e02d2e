//! Convolution layers: what they are, and which algorithm runs them.

use rayon::prelude::*;

use crate::{Isa, KernelError, Tensor, Workspace};

/// What is applied to every output of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Activation {
    /// Nothing.
    #[default]
    Identity,
    /// `max(x, 0)`.
    Relu,
}

impl Activation {
    /// The activation of one value.
    #[must_use]
    pub fn apply(self, value: f32) -> f32 {
        match self {
            Activation::Identity => value,
            Activation::Relu => value.max(0.0),
        }
    }
}

/// The shape of a convolution. The padding is `kernel / 2` zeros on every side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConvSpec {
    /// Channels of the input.
    pub in_channels: usize,
    /// Channels of the output.
    pub out_channels: usize,
    /// Side of the kernel: 1 or 3.
    pub kernel: usize,
    /// Step between outputs: 1 or 2.
    pub stride: usize,
}

impl ConvSpec {
    /// Number of weights, `out x in x kernel x kernel`.
    #[must_use]
    pub fn weight_len(&self) -> usize {
        self.out_channels * self.in_channels * self.kernel * self.kernel
    }

    /// Height or width of the output for that of the input: `ceil(input / stride)`.
    #[must_use]
    pub fn output_size(&self, input: usize) -> usize {
        input.div_ceil(self.stride)
    }

    /// Checks that the kernels can run this convolution.
    ///
    /// # Errors
    /// [`KernelError::UnsupportedKernel`], [`KernelError::UnsupportedStride`] or [`KernelError::NoChannels`].
    pub fn validate(&self) -> Result<(), KernelError> {
        if self.in_channels == 0 || self.out_channels == 0 {
            return Err(KernelError::NoChannels);
        }
        if !matches!(self.kernel, 1 | 3) {
            return Err(KernelError::UnsupportedKernel(self.kernel));
        }
        if !matches!(self.stride, 1 | 2) {
            return Err(KernelError::UnsupportedStride(self.stride));
        }
        Ok(())
    }
}

/// A convolution with its weights laid out for the kernels, bias and activation included.
pub struct Conv2d {
    spec: ConvSpec,
    /// `[kernel row][kernel column][in][out]`
    weight: Vec<f32>,
    bias: Vec<f32>,
    activation: Activation,
}

impl Conv2d {
    /// Prepares a convolution: `y = activation(weight * x + bias)`.
    ///
    /// `weight_oihw` is `[out, in, kernel, kernel]` as PyTorch has it (cross-correlation), `bias` is `[out]`.
    ///
    /// # Errors
    /// [`KernelError`] where the specification is not supported or a slice has the wrong length.
    pub fn new(
        _isa: Isa,
        spec: ConvSpec,
        weight_oihw: &[f32],
        bias: &[f32],
        activation: Activation,
    ) -> Result<Self, KernelError> {
        spec.validate()?;
        if weight_oihw.len() != spec.weight_len() {
            return Err(KernelError::WeightLength {
                expected: spec.weight_len(),
                found: weight_oihw.len(),
            });
        }
        if bias.len() != spec.out_channels {
            return Err(KernelError::BiasLength {
                expected: spec.out_channels,
                found: bias.len(),
            });
        }
        let taps = spec.kernel * spec.kernel;
        let mut weight = vec![0.0; spec.weight_len()];
        for o in 0..spec.out_channels {
            for i in 0..spec.in_channels {
                for tap in 0..taps {
                    weight[(tap * spec.in_channels + i) * spec.out_channels + o] =
                        weight_oihw[(o * spec.in_channels + i) * taps + tap];
                }
            }
        }
        Ok(Self {
            spec,
            weight,
            bias: bias.to_vec(),
            activation,
        })
    }

    /// The shape that it was made for.
    #[must_use]
    pub fn spec(&self) -> ConvSpec {
        self.spec
    }

    /// Runs the convolution. `output` is reshaped to `ceil(h / stride) x ceil(w / stride) x out_channels`.
    ///
    /// # Panics
    /// If `input` has not `in_channels` channels.
    pub fn forward(&self, input: &Tensor, output: &mut Tensor, _workspace: &mut Workspace) {
        let spec = self.spec;
        assert_eq!(
            input.channels(),
            spec.in_channels,
            "input channels of the convolution"
        );
        let (oh, ow) = (
            spec.output_size(input.height()),
            spec.output_size(input.width()),
        );
        output.reshape(oh, ow, spec.out_channels);
        let (row, pixel) = (output.row_stride(), output.channel_stride());
        let halo = 1 - spec.kernel / 2;
        output
            .as_mut_slice()
            .par_chunks_exact_mut(row)
            .skip(1)
            .take(oh)
            .enumerate()
            .for_each(|(y, line)| {
                for x in 0..ow {
                    let out = &mut line[(x + 1) * pixel..][..spec.out_channels];
                    out.copy_from_slice(&self.bias);
                    for tap in 0..spec.kernel * spec.kernel {
                        let from = input.offset(
                            y * spec.stride + tap / spec.kernel + halo,
                            x * spec.stride + tap % spec.kernel + halo,
                        );
                        for (i, &value) in input.as_slice()[from..][..spec.in_channels]
                            .iter()
                            .enumerate()
                        {
                            let weights =
                                &self.weight[(tap * spec.in_channels + i) * spec.out_channels..];
                            for (sum, weight) in out.iter_mut().zip(weights) {
                                *sum += value * weight;
                            }
                        }
                    }
                    for sum in out {
                        *sum = self.activation.apply(*sum);
                    }
                }
            });
    }
}
