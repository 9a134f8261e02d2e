//! Products of few rows with a large matrix, which is read once, as it is stored.

use std::ops::Range;

use half::f16;

use crate::Isa;
use crate::matrix::{MatMut, MatRef, check_shapes};
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::workspace::with_pooled;

/// Rows of `b` that one task multiplies.
const BLOCK: usize = 64;
/// Rows of `b` in a tile: as many streams from memory.
const COLUMNS: usize = 4;

/// A number that is converted to single precision as it is loaded: `f32`, `f16` or `i8`.
pub trait Stored: Element {}

impl Stored for f32 {}
impl Stored for f16 {}
impl Stored for i8 {}

/// How a [`Stored`] number is loaded.
pub trait Element: Copy + Sync {
    /// In single precision, exactly.
    fn widened(self) -> f32;

    /// # Safety
    /// `S::LANES` elements must be readable at `from`.
    #[allow(private_bounds, private_interfaces)]
    unsafe fn load<S: Simd>(simd: S, from: *const Self) -> S::V;
}

macro_rules! element {
    ($type:ty, $load:ident) => {
        impl Element for $type {
            #[inline(always)]
            fn widened(self) -> f32 {
                f32::from(self)
            }

            #[inline(always)]
            #[allow(private_bounds, private_interfaces)]
            unsafe fn load<S: Simd>(simd: S, from: *const Self) -> S::V {
                // SAFETY: the caller's contract.
                unsafe { simd.$load(from) }
            }
        }
    };
}

element!(f32, load);
element!(f16, load_f16);
element!(i8, load_i8);

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten). For few rows of `a`: `b` is neither packed nor
/// copied, and each of its rows is read once for every four rows of `a`.
///
/// # Panics
/// If the shapes do not fit each other.
#[track_caller]
pub fn matmul_nt_stored<T: Stored>(
    isa: Isa,
    a: MatRef<'_, f32>,
    b: MatRef<'_, T>,
    mut c: MatMut<'_, f32>,
) {
    check_shapes(
        [a.rows(), a.cols()],
        [b.cols(), b.rows()],
        [c.rows(), c.cols()],
    );
    let out_stride = c.row_stride();
    let out = SharedMut::new(c.data_mut());
    let n = b.rows();
    with_pooled(|workspace| {
        for_each(&mut workspace.workers, 0, n.div_ceil(BLOCK), |_, block| {
            let columns = block * BLOCK..n.min((block + 1) * BLOCK);
            // SAFETY: `c` has `a.rows()` rows of `n` columns, and these columns belong to this task.
            isa.run(unsafe { DotBlock::new(a, b, columns, out, out_stride) });
        });
    });
}

/// `c[i][j]` for all rows `i` of `a` and `columns` `j`.
struct DotBlock<'a, T> {
    a: MatRef<'a, f32>,
    b: MatRef<'a, T>,
    columns: Range<usize>,
    out: SharedMut,
    out_stride: usize,
}

impl<'a, T: Stored> DotBlock<'a, T> {
    /// # Safety
    /// `columns` must be rows of `b`. Until the kernel has run, `out` must hold `a.rows()` rows, `out_stride` apart, whose
    /// `columns` are written by no other thread.
    unsafe fn new(
        a: MatRef<'a, f32>,
        b: MatRef<'a, T>,
        columns: Range<usize>,
        out: SharedMut,
        out_stride: usize,
    ) -> Self {
        Self {
            a,
            b,
            columns,
            out,
            out_stride,
        }
    }

    /// `R x C` products from row `i`, column `j` on; returns `R`.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(&self, simd: S, i: usize, j: usize) -> usize {
        let k = self.a.cols();
        let a: [&[f32]; R] = std::array::from_fn(|r| &self.a.row(i + r)[..k]);
        let b: [&[T]; C] = std::array::from_fn(|c| &self.b.row(j + c)[..k]);
        let mut sums = [[simd.zero(); C]; R];
        let whole = k / S::LANES * S::LANES;
        for l in (0..whole).step_by(S::LANES) {
            // SAFETY: `l + LANES <= k`, the length of every row.
            let b: [S::V; C] =
                std::array::from_fn(|c| unsafe { T::load(simd, b[c].as_ptr().add(l)) });
            for (sums, a) in sums.iter_mut().zip(a) {
                // SAFETY: as above.
                let a = unsafe { simd.load(a.as_ptr().add(l)) };
                for (sum, b) in sums.iter_mut().zip(b) {
                    *sum = simd.mul_add(a, b, *sum);
                }
            }
        }
        for (r, sums) in sums.into_iter().enumerate() {
            for (c, sum) in sums.into_iter().enumerate() {
                let rest: f32 = a[r][whole..]
                    .iter()
                    .zip(&b[c][whole..])
                    .map(|(a, b)| a * b.widened())
                    .sum();
                // SAFETY: the contract of `new`: an element of `c`, whose columns belong to this block.
                unsafe { *self.out.at((i + r) * self.out_stride + j + c) = simd.sum(sum) + rest };
            }
        }
        R
    }
}

impl<T: Stored> Kernel for DotBlock<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let m = self.a.rows();
        for j in self.columns.clone().step_by(COLUMNS) {
            if self.columns.end - j < COLUMNS {
                for (i, j) in (0..m).flat_map(|i| (j..self.columns.end).map(move |j| (i, j))) {
                    self.tile::<S, 1, 1>(simd, i, j);
                }
                continue;
            }
            let mut i = 0;
            while i < m {
                i += match m - i {
                    // The sums of four rows need 16 registers.
                    4.. if S::MR >= 12 => self.tile::<S, 4, COLUMNS>(simd, i, j),
                    2.. => self.tile::<S, 2, COLUMNS>(simd, i, j),
                    _ => self.tile::<S, 1, COLUMNS>(simd, i, j),
                };
            }
        }
    }
}
