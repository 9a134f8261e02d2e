//! The micro-kernel of convolutions and matrix products, and the packing of its right operand.
//!
//! The scheme is that of BLIS (Goto & van de Geijn 2008; Van Zee & van de Geijn 2015) without blocking of the depth
//! (kc = k): the right operand is packed into *panels* of nr columns, `[depth][nr]`, which the inner loop reads in one
//! stream from the L1 or L2 cache; a micro-tile of up to mr x nr sums stays in registers; the left operand is not packed.
//! nr is two vectors ([`NR_VECTORS`]) and mr is [`Simd::MR`]: 12 x 32 with AVX-512, 6 x 16 with AVX2, 12 x 8 with NEON. A
//! panel of the deepest layer of the default network (3 x 3 x 128 channels) takes 147 kB with AVX-512.
//!
//! The left operand is described by strides and by *taps* (offsets that the depth is made of), so a convolution needs no
//! copy of its input: for a 3x3 kernel the taps are the nine neighbours of a pixel, for a matrix there is one.

use crate::buffer::AlignedBuffer;
use crate::simd::{Kernel, Simd};
use crate::{Activation, Isa};

/// Vectors in a row of a panel (nr = `NR_VECTORS` x lanes); the last panel may have one.
const NR_VECTORS: usize = 2;
/// The largest [`Simd::MR`].
const MAX_MR: usize = 12;

/// Repeats a block for each `r` below a constant, at most [`MAX_MR`] times. In each repetition `r` is a literal: the compiler keeps an
/// array that is only indexed by literals in registers, but one that is indexed in a loop only if nothing disturbs it later, and a
/// micro-tile that is stored in each step takes 1.6 times as long.
macro_rules! unrolled {
    ($r:ident < $count:expr, $body:block) => {
        unrolled!(@ $r, $count, $body, 0 1 2 3 4 5 6 7 8 9 10 11)
    };
    (@ $r:ident, $count:expr, $body:block, $($literal:literal)*) => {
        $(
            if $literal < $count {
                #[allow(non_upper_case_globals, reason = "a counter")]
                const $r: usize = $literal;
                $body
            }
        )*
    };
}

/// How columns are divided into panels.
#[derive(Clone, Copy)]
pub(crate) struct PanelShape {
    lanes: usize,
    columns: usize,
}

impl PanelShape {
    /// For `columns` columns, which must be a multiple of the lanes of `isa`.
    pub(crate) fn new(isa: Isa, columns: usize) -> Self {
        let lanes = isa.lanes();
        debug_assert!(columns.is_multiple_of(lanes));
        Self { lanes, columns }
    }

    /// Columns over all panels.
    pub(crate) fn columns(&self) -> usize {
        self.columns
    }

    /// Number of panels.
    pub(crate) fn count(&self) -> usize {
        self.columns.div_ceil(NR_VECTORS * self.lanes)
    }

    /// First column of a panel. Times the depth, it is the offset of the panel in the packed matrix.
    pub(crate) fn start(&self, panel: usize) -> usize {
        panel * NR_VECTORS * self.lanes
    }

    /// Columns of a panel.
    pub(crate) fn width(&self, panel: usize) -> usize {
        (self.columns - self.start(panel)).min(NR_VECTORS * self.lanes)
    }

    /// Panel of a column.
    pub(crate) fn panel_of(&self, column: usize) -> usize {
        column / (NR_VECTORS * self.lanes)
    }
}

/// A matrix `depth x columns` packed into panels, each `[depth][width]`.
pub(crate) struct Panels {
    pub(crate) shape: PanelShape,
    pub(crate) depth: usize,
    data: AlignedBuffer,
}

impl Panels {
    /// Packs `value(depth index, column)`.
    pub(crate) fn pack(
        isa: Isa,
        depth: usize,
        columns: usize,
        value: impl Fn(usize, usize) -> f32,
    ) -> Self {
        let shape = PanelShape::new(isa, columns);
        let mut data = AlignedBuffer::zeroed(depth * columns);
        let floats = data.as_mut_slice();
        for panel in 0..shape.count() {
            let (start, width) = (shape.start(panel), shape.width(panel));
            let panel = &mut floats[start * depth..][..width * depth];
            for (d, row) in panel.chunks_exact_mut(width).enumerate() {
                for (j, out) in row.iter_mut().enumerate() {
                    *out = value(d, start + j);
                }
            }
        }
        Self { shape, depth, data }
    }

    /// The packed floats of a panel.
    pub(crate) fn panel(&self, panel: usize) -> &[f32] {
        &self.data.as_slice()[self.shape.start(panel) * self.depth..]
            [..self.shape.width(panel) * self.depth]
    }
}

/// What is done with the sums.
#[derive(Clone, Copy)]
pub(crate) enum Finish {
    /// `out = sum`
    Store,
    /// `out += sum`
    Add,
    /// `out = sum + bias`, one bias for each column of the panel.
    Bias(*const f32),
    /// `out = max(sum + bias, 0)`
    BiasRelu(*const f32),
}

impl Finish {
    /// Bias and activation; `bias` holds one value for each column of the panel.
    pub(crate) fn layer(bias: &[f32], activation: Activation) -> Self {
        match activation {
            Activation::Identity => Self::Bias(bias.as_ptr()),
            Activation::Relu => Self::BiasRelu(bias.as_ptr()),
        }
    }

    /// Writes the sums of one vector of columns, the first of which is `column`, to the row `out`.
    ///
    /// # Safety
    /// A vector at `out + column`, and at `column` of the bias, must be readable, and the first one writable.
    #[inline(always)]
    unsafe fn apply<S: Simd>(self, simd: S, sum: S::V, out: *mut f32, column: usize) {
        // SAFETY: the caller's contract.
        unsafe {
            let out = out.add(column);
            let value = match self {
                Self::Store => sum,
                Self::Add => simd.add(simd.load(out), sum),
                Self::Bias(bias) => simd.add(sum, simd.load(bias.add(column))),
                Self::BiasRelu(bias) => {
                    simd.max(simd.zero(), simd.add(sum, simd.load(bias.add(column))))
                }
            };
            simd.store(out, value);
        }
    }
}

/// A rectangle of offsets, row by row.
#[derive(Clone, Copy)]
pub(crate) struct Taps {
    pub(crate) rows: usize,
    pub(crate) row_step: usize,
    pub(crate) columns: usize,
    pub(crate) column_step: usize,
}

impl Taps {
    /// The single offset 0.
    pub(crate) const ONE: Taps = Taps::line(1, 0);

    /// `count` offsets, `step` apart.
    pub(crate) const fn line(count: usize, step: usize) -> Self {
        Self {
            rows: 1,
            row_step: 0,
            columns: count,
            column_step: step,
        }
    }
}

/// The left operand: element `(r, tap, d)` is at `start + r * row_stride + offset of the tap + d * depth_stride`.
#[derive(Clone, Copy)]
pub(crate) struct LeftRows {
    pub(crate) start: *const f32,
    pub(crate) rows: usize,
    pub(crate) row_stride: usize,
    pub(crate) taps: Taps,
    /// Elements of each tap.
    pub(crate) depth: usize,
    pub(crate) depth_stride: usize,
}

/// A panel of the right operand: element `(tap, d, j)` is at `start + (tap * depth + d) * row_stride + j`.
#[derive(Clone, Copy)]
pub(crate) struct RightPanel {
    pub(crate) start: *const f32,
    /// The width if the panel is packed.
    pub(crate) row_stride: usize,
    /// Columns: the lanes of the instruction set, once or twice.
    pub(crate) width: usize,
}

impl RightPanel {
    /// A packed panel.
    pub(crate) fn packed(panel: &[f32], width: usize) -> Self {
        Self {
            start: panel.as_ptr(),
            row_stride: width,
            width,
        }
    }
}

/// The output: element `(r, j)` is at `start + r * row_stride + j`.
#[derive(Clone, Copy)]
pub(crate) struct OutputRows {
    pub(crate) start: *mut f32,
    pub(crate) row_stride: usize,
}

/// The product of a run of rows and one panel: `out[r][j] = finish(sum over taps t and depths d of
/// left[r][t][d] * right[t][d][j])`.
pub(crate) struct PanelProduct {
    left: LeftRows,
    right: RightPanel,
    out: OutputRows,
    finish: Finish,
}

impl PanelProduct {
    /// # Safety
    /// Until the kernel has run, every element of `left` and `right` (as their types define them), and `right.width`
    /// floats of a bias, must be readable; every element of `out`, `left.rows` x `right.width`, must be writable and
    /// must not be read or written by other threads. `out` must not overlap the other operands.
    pub(crate) unsafe fn new(
        left: LeftRows,
        right: RightPanel,
        out: OutputRows,
        finish: Finish,
    ) -> Self {
        Self {
            left,
            right,
            out,
            finish,
        }
    }

    /// All rows, a micro-tile at a time.
    #[inline(always)]
    fn columns<S: Simd, const V: usize>(mut self, simd: S) {
        while self.left.rows > 0 {
            // SAFETY: the contract of `new`; each step takes at most the rows that are left.
            unsafe {
                match self.left.rows {
                    // Two tiles of eight rows use the registers better than one of twelve and one of four.
                    16 if S::MR >= 12 => self.tile::<S, 8, V>(simd),
                    12.. if S::MR >= 12 => self.tile::<S, 12, V>(simd),
                    8.. if S::MR >= 12 => self.tile::<S, 8, V>(simd),
                    6.. => self.tile::<S, 6, V>(simd),
                    4.. => self.tile::<S, 4, V>(simd),
                    3 => self.tile::<S, 3, V>(simd),
                    2 => self.tile::<S, 2, V>(simd),
                    _ => self.tile::<S, 1, V>(simd),
                }
            }
        }
    }

    /// The micro-tile of the next `R` rows and `V` vectors of columns.
    ///
    /// # Safety
    /// At least `R` rows must be left.
    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(&mut self, simd: S) {
        const { assert!(R <= MAX_MR && V <= NR_VECTORS) };
        let mut sums = [[simd.zero(); NR_VECTORS]; MAX_MR];
        let LeftRows { taps, .. } = self.left;
        let mut b = self.right.start;
        // SAFETY: the contract of `new`.
        unsafe {
            for tap_row in 0..taps.rows {
                for tap_column in 0..taps.columns {
                    let mut a = self
                        .left
                        .start
                        .add(tap_row * taps.row_step + tap_column * taps.column_step);
                    for _ in 0..self.left.depth {
                        let first = simd.load(b);
                        let second = if V > 1 {
                            simd.load(b.add(S::LANES))
                        } else {
                            first
                        };
                        unrolled!(r < R, {
                            let value = simd.splat(*a.add(r * self.left.row_stride));
                            sums[r][0] = simd.mul_add(value, first, sums[r][0]);
                            if V > 1 {
                                sums[r][1] = simd.mul_add(value, second, sums[r][1]);
                            }
                        });
                        a = a.wrapping_add(self.left.depth_stride);
                        b = b.wrapping_add(self.right.row_stride);
                    }
                }
            }
            unrolled!(r < R, {
                let out = self.out.start.add(r * self.out.row_stride);
                self.finish.apply(simd, sums[r][0], out, 0);
                if V > 1 {
                    self.finish.apply(simd, sums[r][1], out, S::LANES);
                }
            });
        }
        // After the last row they may be beyond the memory: a panel begins in the middle of a row.
        self.left.start = self.left.start.wrapping_add(R * self.left.row_stride);
        self.out.start = self.out.start.wrapping_add(R * self.out.row_stride);
        self.left.rows -= R;
    }
}

impl Kernel for PanelProduct {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        if self.right.width == S::LANES {
            self.columns::<S, 1>(simd);
        } else {
            self.columns::<S, NR_VECTORS>(simd);
        }
    }
}
