//! Convolution layers, and the choice of their algorithm.

use crate::buffer::AlignedBuffer;
use crate::direct::DirectWeights;
use crate::tensor::{CHANNEL_BLOCK, channel_stride};
use crate::winograd::{self, Direction, TensorSink, TensorSource, WinogradWeights};
use crate::{Isa, KernelError, Tensor, Workspace};

/// Function that is applied to every output of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Activation {
    /// `x`
    #[default]
    Identity,
    /// `max(x, 0)`; NaN stays NaN.
    Relu,
}

impl Activation {
    /// Applies it to one value.
    #[must_use]
    pub fn apply(self, value: f32) -> f32 {
        match self {
            Activation::Identity => value,
            Activation::Relu if value < 0.0 => 0.0,
            Activation::Relu => value,
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
    /// Number of weights, `out x in x kernel x kernel`. One that does not fit `usize` is `usize::MAX`, which no slice has: kernels
    /// write through pointers, so that a slice of the right length must have room for all channels.
    #[must_use]
    pub fn weight_len(&self) -> usize {
        [self.in_channels, self.kernel, self.kernel]
            .into_iter()
            .fold(self.out_channels, usize::saturating_mul)
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
    algorithm: Algorithm,
    /// One for each output channel, padding included.
    bias: AlignedBuffer,
    activation: Activation,
}

enum Algorithm {
    Winograd(WinogradWeights),
    Direct(DirectWeights),
}

impl Conv2d {
    /// Prepares a convolution: `y = activation(weight * x + bias)`.
    ///
    /// `weight_oihw` is `[out, in, kernel, kernel]` as in PyTorch (cross-correlation), `bias` is `[out]`. 3x3 kernels with
    /// stride 1 use Winograd F(4x4, 3x3); all others, and inputs or outputs of up to four channels, are computed directly.
    ///
    /// # Errors
    /// [`KernelError`] if the specification is not supported or a slice has the wrong length.
    pub fn new(
        isa: Isa,
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
        let bias = padded_bias(bias, spec.out_channels)?;
        let blocks = |channels| channel_stride(channels).is_multiple_of(CHANNEL_BLOCK);
        let algorithm = if spec.kernel == 3
            && spec.stride == 1
            && blocks(spec.in_channels)
            && blocks(spec.out_channels)
        {
            let mut weights = WinogradWeights::default();
            let scratch = &mut AlignedBuffer::default();
            weights.set(
                isa,
                Direction::Forward,
                spec.out_channels,
                spec.in_channels,
                weight_oihw,
                scratch,
            );
            Algorithm::Winograd(weights)
        } else {
            Algorithm::Direct(DirectWeights::new(isa, spec, weight_oihw))
        };
        Ok(Self {
            spec,
            algorithm,
            bias,
            activation,
        })
    }

    /// Its shape.
    #[must_use]
    pub fn spec(&self) -> ConvSpec {
        self.spec
    }

    /// Runs the convolution. `output` is reshaped to `ceil(h / stride) x ceil(w / stride) x out_channels`.
    ///
    /// # Panics
    /// If `input` does not have `in_channels` channels.
    pub fn forward(&self, input: &Tensor, output: &mut Tensor, workspace: &mut Workspace) {
        let spec = self.spec;
        assert_eq!(
            input.channels(),
            spec.in_channels,
            "input channels of the convolution"
        );
        output.reshape(
            spec.output_size(input.height()),
            spec.output_size(input.width()),
            spec.out_channels,
        );
        let bias = self.bias.as_slice();
        match &self.algorithm {
            Algorithm::Winograd(weights) => {
                let source = TensorSource::new(input);
                let sink = TensorSink::new(output, bias, self.activation);
                winograd::convolve(weights, source.tiles(), &source, &sink, workspace);
            }
            Algorithm::Direct(weights) => weights.forward(input, output, bias, self.activation),
        }
    }
}

/// The bias, with zeros for the padding channels.
pub(crate) fn padded_bias(bias: &[f32], out_channels: usize) -> Result<AlignedBuffer, KernelError> {
    if bias.len() != out_channels {
        return Err(KernelError::BiasLength {
            expected: out_channels,
            found: bias.len(),
        });
    }
    let mut padded = AlignedBuffer::zeroed(channel_stride(out_channels));
    padded.as_mut_slice()[..out_channels].copy_from_slice(bias);
    Ok(padded)
}
