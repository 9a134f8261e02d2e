//! Transposed convolution 4x4, stride 2, padding 1: doubles height and width.

use crate::buffer::AlignedBuffer;
use crate::conv::padded_bias;
use crate::panel::{Finish, LeftRows, OutputRows, PanelProduct, Panels, RightPanel, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::tensor::channel_stride;
use crate::{Activation, Isa, KernelError, Tensor, Workspace};

const SIDE: usize = 4;

/// A transposed convolution 4x4, stride 2, padding 1 (PyTorch's `ConvTranspose2d(ci, co, 4, 2, 1)`).
pub struct ConvTranspose2d {
    in_channels: usize,
    out_channels: usize,
    isa: Isa,
    /// Output pixels whose row and column have the same parities depend on the same four taps: four 2x2 convolutions,
    /// index `2 * row parity + column parity`, depth `[2][2][in]`.
    phases: [Panels; 4],
    /// One for each output channel, padding included.
    bias: AlignedBuffer,
    activation: Activation,
}

impl ConvTranspose2d {
    /// Prepares a transposed convolution. `weight_iohw` is `[in, out, 4, 4]` as PyTorch has it, `bias` is `[out]`.
    ///
    /// # Errors
    /// [`KernelError`] if a number of channels is zero or a slice has the wrong length.
    pub fn new(
        isa: Isa,
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
        let bias = padded_bias(bias, out_channels)?;
        let stride = channel_stride(out_channels);
        let isa = isa.for_stride(stride);
        let phases = std::array::from_fn(|phase| {
            Panels::pack(isa, 4 * in_channels, stride, |depth, o| {
                if o >= out_channels {
                    return 0.0;
                }
                let (tap, i) = (depth / in_channels, depth % in_channels);
                let (ky, kx) = (
                    kernel_index(phase / 2, tap / 2),
                    kernel_index(phase % 2, tap % 2),
                );
                weight_iohw[((i * out_channels + o) * SIDE + ky) * SIDE + kx]
            })
        });
        Ok(Self {
            in_channels,
            out_channels,
            isa,
            phases,
            bias,
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

    /// Runs the convolution. `output` is reshaped to `2 h x 2 w x out_channels`.
    ///
    /// # Panics
    /// If `input` does not have `in_channels` channels.
    pub fn forward(&self, input: &Tensor, output: &mut Tensor, workspace: &mut Workspace) {
        assert_eq!(
            input.channels(),
            self.in_channels,
            "input channels of the transposed convolution"
        );
        let (h, w) = (input.height(), input.width());
        output.reshape(2 * h, 2 * w, self.out_channels);
        let (row, pixel) = (output.row_stride(), output.channel_stride());
        let out = SharedMut::new(output.as_mut_slice());
        let panels = self.phases[0].shape.count();
        // A task reads the weights of its panel once for several rows.
        let band = h.div_ceil(rayon::current_num_threads()).clamp(1, 16);
        for_each(
            &mut workspace.workers,
            0,
            h.div_ceil(band) * 4 * panels,
            |_, task| {
                let (rows, phase, panel) = (task / (4 * panels), task / panels % 4, task % panels);
                let (odd_y, odd_x) = (phase / 2, phase % 2);
                let weights = &self.phases[phase];
                let start = weights.shape.start(panel);
                for y in rows * band..((rows + 1) * band).min(h) {
                    // SAFETY: the taps of the first pixel start at this one or its upper left neighbour, inside the halo;
                    // the bias has a value for each column of the panel; each output pixel and panel belongs to one task.
                    let run = unsafe {
                        let left = LeftRows {
                            start: input
                                .as_slice()
                                .as_ptr()
                                .add(input.offset(y + odd_y, odd_x)),
                            rows: w,
                            row_stride: input.channel_stride(),
                            taps: Taps {
                                rows: 2,
                                row_step: input.row_stride(),
                                columns: 2,
                                column_step: input.channel_stride(),
                            },
                            depth: self.in_channels,
                            depth_stride: 1,
                        };
                        let right =
                            RightPanel::packed(weights.panel(panel), weights.shape.width(panel));
                        let to = OutputRows {
                            start: out.at((2 * y + odd_y + 1) * row + (odd_x + 1) * pixel + start),
                            row_stride: 2 * pixel,
                        };
                        let bias = &self.bias.as_slice()[start..];
                        PanelProduct::new(left, right, to, Finish::layer(bias, self.activation))
                    };
                    self.isa.run(run);
                }
            },
        );
    }
}

/// Row (or column) of the kernel by which tap 0 or 1 of an output of this parity is multiplied: output `2 i + parity` is the sum over
/// inputs `i + parity - 1 + tap` with kernel index `output + 1 - 2 * input`.
fn kernel_index(parity: usize, tap: usize) -> usize {
    3 - parity - 2 * tap
}
