//! Weights of bytes as the kernels read them.

use super::dots::{ByteDots, DotKernel, Dots};
use super::tensor::{WORD, byte_pitch};
use super::weights::QuantisedWeights;
use crate::ConvSpec;
use crate::buffer::AlignedBuffer;

/// Vectors of sums in a panel; as one of three are, so that nothing is left over, three.
const VECTORS: usize = 2;

/// A convolution's weights in panels of output channels: `[panel][tap row][word][vector][lane][4]`, where the words of a tap row
/// are those of the pixels of a kernel's row, padding included.
pub(super) struct PackedWeights {
    pub dots: Dots,
    /// Words of a row of the kernel.
    pub words: usize,
    /// Output channels, padding included.
    pub columns: usize,
    lanes: usize,
    vectors: usize,
    depth: usize,
    weights: AlignedBuffer,
    start: AlignedBuffer,
}

/// A panel.
#[derive(Clone, Copy)]
pub(super) struct Panel {
    /// First output channel.
    pub column: usize,
    /// Vectors of sums: 1, 2 or 3.
    pub vectors: usize,
    pub weights: *const i8,
    pub start: *const i32,
}

/// What packing needs to know of the instructions.
struct Layout;
impl DotKernel for Layout {
    type Output = (usize, i32);
    #[inline(always)]
    fn run<D: ByteDots>(self, _: D) -> (usize, i32) {
        (D::LANES, D::OFFSET)
    }
}

impl PackedWeights {
    /// `pitch`: bytes from one pixel of the input to the next.
    pub fn new(dots: Dots, spec: ConvSpec, pitch: usize, weights: &QuantisedWeights) -> Self {
        let (lanes, offset) = dots.run(Layout);
        let columns = byte_pitch(spec.out_channels);
        let vectors = if columns == 3 * lanes { 3 } else { VECTORS };
        let words = spec.kernel * pitch / WORD;
        let depth = spec.kernel * words;
        let mut packed = Self {
            dots,
            words,
            columns,
            lanes,
            vectors,
            depth,
            weights: AlignedBuffer::zeroed(depth * columns),
            start: AlignedBuffer::zeroed(columns),
        };
        packed.fill(spec, pitch, weights, offset);
        packed
    }

    fn fill(&mut self, spec: ConvSpec, pitch: usize, from: &QuantisedWeights, offset: i32) {
        let (width, depth) = (self.vectors * self.lanes, self.depth);
        let taps = spec.kernel * spec.kernel;
        let bytes: &mut [i8] = bytemuck::cast_slice_mut(self.weights.as_mut_slice());
        let start: &mut [i32] = bytemuck::cast_slice_mut(self.start.as_mut_slice());
        for (o, start) in start.iter_mut().enumerate().take(spec.out_channels) {
            let (panel, column) = (o / width, o % width);
            let panel_width = width.min(self.columns - panel * width);
            let panel = &mut bytes[panel * width * depth * WORD..];
            let kernel = &from.values[o * spec.in_channels * taps..][..spec.in_channels * taps];
            for (i, tap) in (0..spec.in_channels).flat_map(|i| (0..taps).map(move |t| (i, t))) {
                let (row, byte) = (tap / spec.kernel, tap % spec.kernel * pitch + i);
                let word = row * self.words + byte / WORD;
                panel[(word * panel_width + column) * WORD + byte % WORD] = kernel[i * taps + tap];
            }
            let sum: i32 = kernel.iter().map(|&w| i32::from(w)).sum();
            *start = from.start[o].wrapping_sub(offset.wrapping_mul(sum));
        }
    }

    /// Number of panels.
    pub fn panels(&self) -> usize {
        self.columns.div_ceil(self.vectors * self.lanes)
    }

    /// # Panics
    /// If there is no such panel.
    pub fn panel(&self, panel: usize) -> Panel {
        let column = panel * self.vectors * self.lanes;
        let weights: &[i8] = bytemuck::cast_slice(self.weights.as_slice());
        let start: &[i32] = bytemuck::cast_slice(self.start.as_slice());
        Panel {
            column,
            vectors: self.vectors.min((self.columns - column) / self.lanes),
            weights: weights[column * self.depth * WORD..].as_ptr(),
            start: start[column..].as_ptr(),
        }
    }
}
