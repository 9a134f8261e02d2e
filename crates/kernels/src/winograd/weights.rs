//! Convolution kernels, transformed and packed into panels for the matrix products.

use super::blocks::padded_stride;
use super::transform::{POINTS, weight};
use crate::Isa;
use crate::buffer::AlignedBuffer;
use crate::panel::PanelShape;
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::tensor::{CHANNEL_BLOCK, channel_stride};

/// Direction of a convolution with a weight `[out, in, 3, 3]`.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Direction {
    /// From `in` channels to `out` channels.
    Forward,
    /// From `out` channels to `in` channels, with the kernels rotated by 180 degrees: the gradient of the input.
    Backward,
}

/// Transformed kernels: for each of the 36 points, panels of output channels, each `[in][width]`.
#[derive(Default)]
pub(crate) struct WinogradWeights {
    isa: Option<Isa>,
    /// Channels that the products sum over, a multiple of 16.
    depth: usize,
    columns: usize,
    data: AlignedBuffer,
}

impl WinogradWeights {
    /// Transforms a weight `[out, in, 3, 3]` and replaces the previous one, whose memory is reused.
    pub(crate) fn set(
        &mut self,
        isa: Isa,
        direction: Direction,
        out_channels: usize,
        in_channels: usize,
        weight_oihw: &[f32],
        scratch: &mut AlignedBuffer,
    ) {
        let (from, to) = match direction {
            Direction::Forward => (in_channels, out_channels),
            Direction::Backward => (out_channels, in_channels),
        };
        // Outputs of few channels are computed in full blocks too; the sink ignores the excess.
        (self.isa, self.depth, self.columns) = (
            Some(isa),
            from.next_multiple_of(CHANNEL_BLOCK),
            channel_stride(to).next_multiple_of(CHANNEL_BLOCK),
        );
        let point_stride = self.point_stride();
        self.data.grow(POINTS * point_stride);
        let shape = self.shape();
        let (depth, blocks) = (self.depth, self.depth / CHANNEL_BLOCK);
        let packed = SharedMut::new(self.data.as_mut_slice());
        let widest = shape.width(0);
        for_each(
            scratch,
            9 * CHANNEL_BLOCK * widest,
            shape.count() * blocks,
            |taps, task| {
                let (panel, first) = (task / blocks, task % blocks * CHANNEL_BLOCK);
                let (start, width) = (shape.start(panel), shape.width(panel));
                // [channel][tap][column], zero for channels and columns that do not exist
                taps.fill(0.0);
                let channels = CHANNEL_BLOCK.min(from.saturating_sub(first));
                let columns = width.min(to.saturating_sub(start));
                match direction {
                    Direction::Forward => {
                        for j in 0..columns {
                            let line = &weight_oihw[((start + j) * in_channels + first) * 9..]
                                [..channels * 9];
                            for (tap, &value) in line.iter().enumerate() {
                                taps[tap * width + j] = value;
                            }
                        }
                    }
                    Direction::Backward => {
                        for i in (0..channels).filter(|_| columns > 0) {
                            let line = &weight_oihw[((first + i) * in_channels + start) * 9..]
                                [..columns * 9];
                            for (j, kernel) in line.chunks_exact(9).enumerate() {
                                for (tap, &value) in kernel.iter().enumerate() {
                                    taps[(i * 9 + 8 - tap) * width + j] = value;
                                }
                            }
                        }
                    }
                }
                // SAFETY: `taps` has the length asked for; the rows `first..` of this panel lie inside the buffer at each
                // point, and no other task writes them.
                isa.run(unsafe {
                    let out = packed.at(start * depth + first * width);
                    TransformBlock::new(taps, width, out, point_stride)
                });
            },
        );
    }

    pub(crate) fn isa(&self) -> Isa {
        self.isa.unwrap_or(Isa::Portable)
    }

    pub(crate) fn shape(&self) -> PanelShape {
        PanelShape::new(self.isa(), self.columns)
    }

    /// Input channels, padded.
    pub(crate) fn depth(&self) -> usize {
        self.depth
    }

    /// Size in bytes.
    pub(crate) fn bytes(&self) -> usize {
        POINTS * self.point_stride() * size_of::<f32>()
    }

    /// The packed panel at a point.
    pub(crate) fn panel(&self, point: usize, panel: usize) -> &[f32] {
        let shape = self.shape();
        let start = point * self.point_stride() + shape.start(panel) * self.depth;
        &self.data.as_slice()[start..][..shape.width(panel) * self.depth]
    }

    fn point_stride(&self) -> usize {
        padded_stride(self.depth * self.columns)
    }
}

/// Transforms the kernels of 16 input channels of a panel.
struct TransformBlock<'a> {
    /// `[16][9][width]`
    taps: &'a [f32],
    width: usize,
    /// `[16][width]` at each point
    out: *mut f32,
    point_stride: usize,
}

impl<'a> TransformBlock<'a> {
    /// # Safety
    /// `taps` must hold `[16][9][width]` floats, `width` being whole vectors. Until the kernel has run, `[16][width]` floats
    /// must be writable at `out + point * point_stride` for each point, without other threads reading or writing them.
    unsafe fn new(taps: &'a [f32], width: usize, out: *mut f32, point_stride: usize) -> Self {
        Self {
            taps,
            width,
            out,
            point_stride,
        }
    }
}

impl Kernel for TransformBlock<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        for i in 0..CHANNEL_BLOCK {
            for j in (0..self.width).step_by(S::LANES) {
                let taps = &self.taps[i * 9 * self.width + j..];
                // SAFETY: the contract of `new`.
                unsafe {
                    weight(
                        simd,
                        |tap| simd.load(taps.as_ptr().add(tap * self.width)),
                        |point, value| {
                            simd.store(
                                self.out.add(point * self.point_stride + i * self.width + j),
                                value,
                            )
                        },
                    );
                }
            }
        }
    }
}
