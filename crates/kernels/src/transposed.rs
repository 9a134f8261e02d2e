//! Transposed convolution 4x4, stride 2, padding 1: doubles height and width.

use rayon::prelude::*;

use crate::{Activation, Isa, KernelError, Tensor, Workspace};

const SIDE: usize = 4;

/// A transposed convolution 4x4, stride 2, padding 1 (PyTorch's `ConvTranspose2d(ci, co, 4, 2, 1)`).
pub struct ConvTranspose2d {
    in_channels: usize,
    out_channels: usize,
    /// `[kernel row][kernel column][in][out]`
    weight: Vec<f32>,
    bias: Vec<f32>,
    activation: Activation,
}

impl ConvTranspose2d {
    /// Prepares a transposed convolution. `weight_iohw` is `[in, out, 4, 4]` as PyTorch has it, `bias` is `[out]`.
    ///
    /// # Errors
    /// [`KernelError`] where there are no channels or a slice has the wrong length.
    pub fn new(
        _isa: Isa,
        in_channels: usize,
        out_channels: usize,
        weight_iohw: &[f32],
        bias: &[f32],
        activation: Activation,
    ) -> Result<Self, KernelError> {
        if in_channels == 0 || out_channels == 0 {
            return Err(KernelError::NoChannels);
        }
        let expected = in_channels * out_channels * SIDE * SIDE;
        if weight_iohw.len() != expected {
            return Err(KernelError::WeightLength {
                expected,
                found: weight_iohw.len(),
            });
        }
        if bias.len() != out_channels {
            return Err(KernelError::BiasLength {
                expected: out_channels,
                found: bias.len(),
            });
        }
        let mut weight = vec![0.0; expected];
        for i in 0..in_channels {
            for o in 0..out_channels {
                for tap in 0..SIDE * SIDE {
                    weight[(tap * in_channels + i) * out_channels + o] =
                        weight_iohw[(i * out_channels + o) * SIDE * SIDE + tap];
                }
            }
        }
        Ok(Self {
            in_channels,
            out_channels,
            weight,
            bias: bias.to_vec(),
            activation,
        })
    }

    /// Channels of the input.
    #[must_use]
    pub fn in_channels(&self) -> usize {
        self.in_channels
    }

    /// Channels of the output.
    #[must_use]
    pub fn out_channels(&self) -> usize {
        self.out_channels
    }

    /// Runs it. `output` is reshaped to `2 h x 2 w x out_channels`.
    ///
    /// # Panics
    /// If `input` has not `in_channels` channels.
    pub fn forward(&self, input: &Tensor, output: &mut Tensor, _workspace: &mut Workspace) {
        assert_eq!(
            input.channels(),
            self.in_channels,
            "input channels of the transposed convolution"
        );
        let (oh, ow) = (2 * input.height(), 2 * input.width());
        output.reshape(oh, ow, self.out_channels);
        let (row, pixel) = (output.row_stride(), output.channel_stride());
        output
            .as_mut_slice()
            .par_chunks_exact_mut(row)
            .skip(1)
            .take(oh)
            .enumerate()
            .for_each(|(y, line)| {
                for x in 0..ow {
                    let out = &mut line[(x + 1) * pixel..][..self.out_channels];
                    out.copy_from_slice(&self.bias);
                    // Output row y = 2 iy - 1 + ky: an even one sees kernel rows 1 and 3, an odd one 0 and 2.
                    for ky in ((y + 1) % 2..SIDE).step_by(2) {
                        for kx in ((x + 1) % 2..SIDE).step_by(2) {
                            // One more than the input pixel, for the halo.
                            let from = input.offset((y + 3 - ky) / 2, (x + 3 - kx) / 2);
                            let tap = ky * SIDE + kx;
                            for (i, &value) in input.as_slice()[from..][..self.in_channels]
                                .iter()
                                .enumerate()
                            {
                                let weights = &self.weight
                                    [(tap * self.in_channels + i) * self.out_channels..];
                                for (sum, weight) in out.iter_mut().zip(weights) {
                                    *sum += value * weight;
                                }
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
