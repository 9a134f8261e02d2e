//! The register-blocked product at the heart of convolutions and matrix products alike.
//!
//! A product of rows by columns runs in *panels*: two vectors of columns, packed so that the inner loop reads them in
//! one stream, against up to twelve rows whose sums stay in registers. Where the rows' values lie is described by
//! strides and by *taps* (offsets that the depth is made of), so a convolution needs no copy of its input: for a 3x3
//! kernel the taps are the nine neighbours of a pixel, for a matrix there is one.

use crate::buffer::AlignedBuffer;
use crate::simd::{Kernel, Simd};
use crate::{Activation, Isa};

/// Vectors of columns in a panel; the last panel may have one.
const VECTORS: usize = 2;

/// How columns are cut into panels.
#[derive(Clone, Copy)]
pub(crate) struct PanelShape {
    lanes: usize,
    columns: usize,
}

impl PanelShape {
    /// For `columns` columns, a multiple of the lanes of `isa`.
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
        self.columns.div_ceil(VECTORS * self.lanes)
    }

    /// First column of a panel; times the depth, where the panel starts in the packed matrix.
    pub(crate) fn start(&self, panel: usize) -> usize {
        panel * VECTORS * self.lanes
    }

    /// Columns of a panel.
    pub(crate) fn width(&self, panel: usize) -> usize {
        (self.columns - self.start(panel)).min(VECTORS * self.lanes)
    }

    /// Panel of a column.
    pub(crate) fn panel_of(&self, column: usize) -> usize {
        column / (VECTORS * self.lanes)
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

/// What becomes of the sums.
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
    /// Bias and activation; `bias` holds one for each column of the panel.
    pub(crate) fn layer(bias: &[f32], activation: Activation) -> Self {
        match activation {
            Activation::Identity => Self::Bias(bias.as_ptr()),
            Activation::Relu => Self::BiasRelu(bias.as_ptr()),
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

/// One panel against a run of rows:
/// `out[r * out_stride + j] = finish(sum over taps t, depths d of
/// a[taps[t] + r * row_stride + d * depth_stride] * b[(t * depth + d) * b_stride + j])`.
///
/// Whoever makes one promises that every address of this formula is readable (`a`, `b`, a bias) or writable (`out`), and
/// that nobody else writes or reads the outputs meanwhile.
pub(crate) struct PanelRun {
    pub(crate) a: *const f32,
    pub(crate) row_stride: usize,
    pub(crate) depth_stride: usize,
    pub(crate) taps: Taps,
    pub(crate) depth: usize,
    pub(crate) b: *const f32,
    /// The width, where the panel is packed.
    pub(crate) b_stride: usize,
    /// Columns of the panel: the lanes of the instruction set, once or twice.
    pub(crate) width: usize,
    pub(crate) out: *mut f32,
    pub(crate) out_stride: usize,
    pub(crate) rows: usize,
    pub(crate) finish: Finish,
}

impl PanelRun {
    #[inline(always)]
    fn columns<S: Simd, const V: usize>(mut self, simd: S) {
        while self.rows > 0 {
            // SAFETY: the maker's promise; each step takes at most the rows that are left.
            unsafe {
                match self.rows {
                    // Twice eight rows keep the registers busier than twelve and four.
                    16 if S::ROWS >= 12 => self.tile::<S, 8, V>(simd),
                    12.. if S::ROWS >= 12 => self.tile::<S, 12, V>(simd),
                    8.. if S::ROWS >= 12 => self.tile::<S, 8, V>(simd),
                    6.. => self.tile::<S, 6, V>(simd),
                    4.. => self.tile::<S, 4, V>(simd),
                    3 => self.tile::<S, 3, V>(simd),
                    2 => self.tile::<S, 2, V>(simd),
                    _ => self.tile::<S, 1, V>(simd),
                }
            }
        }
    }

    /// The next `R` rows.
    ///
    /// # Safety
    /// There must be so many left.
    #[inline(always)]
    // Only indexed loops of constant length leave the sums in registers: iterators spill them, at half the speed.
    #[allow(clippy::needless_range_loop)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(&mut self, simd: S) {
        let mut sums = [[simd.zero(); V]; R];
        let mut b = self.b;
        // SAFETY: the maker's promise.
        unsafe {
            for tap_row in 0..self.taps.rows {
                for tap_column in 0..self.taps.columns {
                    let mut a = self
                        .a
                        .add(tap_row * self.taps.row_step + tap_column * self.taps.column_step);
                    for _ in 0..self.depth {
                        let columns: [S::V; V] =
                            std::array::from_fn(|j| simd.load(b.add(j * S::LANES)));
                        for r in 0..R {
                            let value = simd.splat(*a.add(r * self.row_stride));
                            for j in 0..V {
                                sums[r][j] = simd.mul_add(value, columns[j], sums[r][j]);
                            }
                        }
                        a = a.wrapping_add(self.depth_stride);
                        b = b.wrapping_add(self.b_stride);
                    }
                }
            }
            for (r, sums) in sums.iter().enumerate() {
                for (j, &sum) in sums.iter().enumerate() {
                    let out = self.out.add(r * self.out_stride + j * S::LANES);
                    let value = match self.finish {
                        Finish::Store => sum,
                        Finish::Add => simd.add(simd.load(out), sum),
                        Finish::Bias(bias) => simd.add(sum, simd.load(bias.add(j * S::LANES))),
                        Finish::BiasRelu(bias) => simd.max(
                            simd.zero(),
                            simd.add(sum, simd.load(bias.add(j * S::LANES))),
                        ),
                    };
                    simd.store(out, value);
                }
            }
            self.a = self.a.add(R * self.row_stride);
            self.out = self.out.add(R * self.out_stride);
        }
        self.rows -= R;
    }
}

impl Kernel for PanelRun {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        if self.width == S::LANES {
            self.columns::<S, 1>(simd);
        } else {
            self.columns::<S, VECTORS>(simd);
        }
    }
}
