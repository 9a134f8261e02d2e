//! Direct convolution of any kernel and stride: a matrix product of pixels by output channels whose taps are the
//! neighbouring pixels.

use crate::buffer::AlignedBuffer;
use crate::cache::l2_bytes;
use crate::panel::{Finish, LeftRows, OutputRows, PanelProduct, Panels, RightPanel, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::tensor::channel_stride;
use crate::{Activation, ConvSpec, Isa, Tensor};

/// The input rows of a task, which are read again for each panel, take this part of the L2 cache.
const BANDS_IN_L2: usize = 4;

/// Kernels packed in panels of output channels, depth `[kernel row][kernel column][in]`.
pub(crate) struct DirectWeights {
    isa: Isa,
    spec: ConvSpec,
    panels: Panels,
}

impl DirectWeights {
    pub(crate) fn new(isa: Isa, spec: ConvSpec, weight_oihw: &[f32]) -> Self {
        let columns = channel_stride(spec.out_channels);
        let isa = isa.for_stride(columns);
        let taps = spec.kernel * spec.kernel;
        let panels = Panels::pack(isa, taps * spec.in_channels, columns, |depth, o| {
            let (tap, i) = (depth / spec.in_channels, depth % spec.in_channels);
            if o < spec.out_channels {
                weight_oihw[(o * spec.in_channels + i) * taps + tap]
            } else {
                0.0
            }
        });
        Self { isa, spec, panels }
    }

    /// `output` must have its shape already; `bias` has one value for each channel, padding included.
    pub(crate) fn forward(
        &self,
        input: &Tensor,
        output: &mut Tensor,
        bias: &[f32],
        activation: Activation,
    ) {
        let spec = self.spec;
        let (height, width) = (output.height(), output.width());
        let (row, pixel) = (output.row_stride(), output.channel_stride());
        let out = SharedMut::new(output.as_mut_slice());
        let shape = self.panels.shape;
        // Neighbours in a row are contiguous, and so one tap, if pixels have no padding channels.
        let (columns, depth) = if input.channel_stride() == spec.in_channels {
            (1, spec.kernel * spec.in_channels)
        } else {
            (spec.kernel, spec.in_channels)
        };
        let taps = Taps {
            rows: spec.kernel,
            row_step: input.row_stride(),
            columns,
            column_step: input.channel_stride(),
        };
        let halo = 1 - spec.kernel / 2;
        let workers = rayon::current_num_threads();
        let cached =
            l2_bytes() / BANDS_IN_L2 / (input.row_stride() * spec.stride * size_of::<f32>()).max(1);
        let band =
            (height * shape.count() / (8 * workers)).clamp(1, cached.clamp(1, height.max(1)));
        for_each(
            &mut AlignedBuffer::default(),
            0,
            height.div_ceil(band) * shape.count(),
            |_, task| {
                let (rows, panel) = (task / shape.count(), task % shape.count());
                let start = shape.start(panel);
                for y in rows * band..((rows + 1) * band).min(height) {
                    // SAFETY: the taps of all pixels of a row lie inside the input with its halo, since the output is no
                    // larger than input / stride, rounded up; the bias has a value for each column of the panel; each
                    // output pixel and panel belongs to one task.
                    let run = unsafe {
                        let left = LeftRows {
                            start: input
                                .as_slice()
                                .as_ptr()
                                .add(input.offset(y * spec.stride + halo, halo)),
                            rows: width,
                            row_stride: spec.stride * input.channel_stride(),
                            taps,
                            depth,
                            depth_stride: 1,
                        };
                        let to = OutputRows {
                            start: out.at((y + 1) * row + pixel + start),
                            row_stride: pixel,
                        };
                        let right =
                            RightPanel::packed(self.panels.panel(panel), shape.width(panel));
                        PanelProduct::new(
                            left,
                            right,
                            to,
                            Finish::layer(&bias[start..], activation),
                        )
                    };
                    self.isa.run(run);
                }
            },
        );
    }
}
