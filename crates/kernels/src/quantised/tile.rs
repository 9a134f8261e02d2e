//! The micro-kernel: pixels of some rows by a panel of output channels.
//!
//! As in [`crate::panel`], a micro-tile of sums stays in registers, the input is not packed, and a panel of weights is read in one
//! stream from the L1 cache: 36 kB for 3 x 3 x 128 channels and two vectors of AVX-512.

use super::dots::{ByteDots, DotKernel};
use super::pack::Panel;
use super::tensor::WORD;

/// The input: word `(r, x, tap row, w)` is at `start + r * row_step + x * pixel_step + tap row * tap_row_step + 4 w`.
#[derive(Clone, Copy)]
pub(super) struct Input {
    pub start: *const u8,
    /// Bytes from the input of one row of the output to that of the next.
    pub row_step: usize,
    /// Bytes from the input of one pixel of the output to that of the next.
    pub pixel_step: usize,
    pub tap_rows: usize,
    pub tap_row_step: usize,
    /// Words of a tap row.
    pub words: usize,
}

/// Where the output goes, and what it is: pixel `(r, x)` is at `start + r * row_step + x * pixel_step`, in elements.
#[derive(Clone, Copy)]
pub(super) struct Output {
    pub start: Start,
    pub row_step: usize,
    pub pixel_step: usize,
}

/// The first element of the first pixel.
#[derive(Clone, Copy)]
pub(super) enum Start {
    /// `max(sum, 0) * factor`, rounded.
    Bytes(*mut u8),
    /// `sum * factor`
    Floats(*mut f32),
}

impl Start {
    /// # Safety
    /// The element must be in the same memory.
    #[inline(always)]
    unsafe fn add(self, elements: usize) -> Self {
        // SAFETY: the caller's contract.
        unsafe {
            match self {
                Self::Bytes(to) => Self::Bytes(to.add(elements)),
                Self::Floats(to) => Self::Floats(to.add(elements)),
            }
        }
    }
}

/// Rows of pixels by a panel.
pub(super) struct Rows {
    input: Input,
    panel: Panel,
    /// One factor for each column of the panel.
    factors: *const f32,
    output: Output,
    rows: usize,
    width: usize,
}

impl Rows {
    /// # Safety
    /// Until the kernel has run: the words of all pixels, the weights and starts of the panel, and its factors, must be readable;
    /// the panel's elements of all `rows x width` pixels must be writable, and no other thread may use them.
    pub unsafe fn new(
        input: Input,
        panel: Panel,
        factors: *const f32,
        output: Output,
        [rows, width]: [usize; 2],
    ) -> Self {
        Self {
            input,
            panel,
            factors,
            output,
            rows,
            width,
        }
    }

    /// # Safety
    /// `V` must be the vectors of the panel.
    #[inline(always)]
    unsafe fn all<D: ByteDots, const V: usize>(self, dots: D) {
        for row in 0..self.rows {
            let mut x = 0;
            while x < self.width {
                let left = self.width - x;
                // SAFETY: the contract of `new`; no tile has more pixels than are left.
                unsafe {
                    let input = self
                        .input
                        .start
                        .add(row * self.input.row_step + x * self.input.pixel_step);
                    let output = self
                        .output
                        .start
                        .add(row * self.output.row_step + x * self.output.pixel_step);
                    x += match left {
                        // Two tiles of like size use the registers better than a large and a small one.
                        20 if D::TILE >= 10 * V => self.tile::<D, 10, V>(dots, input, output),
                        13..=16 if D::TILE >= 8 * V => self.tile::<D, 8, V>(dots, input, output),
                        12.. if D::TILE >= 12 * V => self.tile::<D, 12, V>(dots, input, output),
                        10.. if D::TILE >= 10 * V => self.tile::<D, 10, V>(dots, input, output),
                        8.. if D::TILE >= 8 * V => self.tile::<D, 8, V>(dots, input, output),
                        6.. if D::TILE >= 6 * V => self.tile::<D, 6, V>(dots, input, output),
                        4.. => self.tile::<D, 4, V>(dots, input, output),
                        2.. => self.tile::<D, 2, V>(dots, input, output),
                        _ => self.tile::<D, 1, V>(dots, input, output),
                    };
                }
            }
        }
    }

    /// The micro-tile of `R` pixels and `V` vectors of columns.
    ///
    /// # Safety
    /// The contract of `new` for `R` pixels of a row that start at `input` and `output`.
    #[inline(always)]
    // Only indexed loops of constant length keep the sums in registers.
    #[allow(clippy::needless_range_loop)]
    unsafe fn tile<D: ByteDots, const R: usize, const V: usize>(
        &self,
        dots: D,
        input: *const u8,
        output: Start,
    ) -> usize {
        // SAFETY: the caller's contract.
        unsafe {
            let start: [D::Sums; V] =
                std::array::from_fn(|j| dots.sums(self.panel.start.add(j * D::LANES)));
            let mut sums = [start; R];
            let mut weights = self.panel.weights;
            for tap_row in 0..self.input.tap_rows {
                let mut from = input.add(tap_row * self.input.tap_row_step);
                for _ in 0..self.input.words {
                    let columns: [D::Weights; V] =
                        std::array::from_fn(|j| dots.weights(weights.add(j * WORD * D::LANES)));
                    for r in 0..R {
                        let word = dots.word(from.add(r * self.input.pixel_step));
                        for j in 0..V {
                            sums[r][j] = dots.dot(sums[r][j], word, columns[j]);
                        }
                    }
                    from = from.add(WORD);
                    weights = weights.add(V * WORD * D::LANES);
                }
            }
            for r in 0..R {
                for j in 0..V {
                    let factors = self.factors.add(j * D::LANES);
                    match output.add(r * self.output.pixel_step + j * D::LANES) {
                        Start::Bytes(to) => dots.store_bytes(to, sums[r][j], factors),
                        Start::Floats(to) => dots.store_floats(to, sums[r][j], factors),
                    }
                }
            }
        }
        R
    }
}

impl DotKernel for Rows {
    type Output = ();
    #[inline(always)]
    fn run<D: ByteDots>(self, dots: D) {
        // SAFETY: the vectors of the panel.
        unsafe {
            match self.panel.vectors {
                1 => self.all::<D, 1>(dots),
                2 => self.all::<D, 2>(dots),
                _ => self.all::<D, 3>(dots),
            }
        }
    }
}
