//! Products of `f32` matrices, row-major.

use crate::Isa;
use crate::layout::Interleave;
use crate::panel::{Finish, PanelRun, PanelShape, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::workspace::with_pooled;

/// Packed columns that are multiplied in one go should stay in the last-level cache.
const PACKED_BYTES: usize = 4 << 20;
/// Rows of `a` in a piece of work.
const ROW_BLOCK: usize = 96;
/// Below this many rows, packing `b` costs more than it saves.
const FEW_ROWS: usize = 12;
/// Rows of `b` in a piece of work where it is not packed.
const DOT_BLOCK: usize = 64;

fn check(m: usize, n: usize, k: usize, a: usize, b: usize, c: usize) {
    assert_eq!(
        (a, b, c),
        (m * k, n * k, m * n),
        "elements of a, b and c for m={m}, n={n}, k={k}"
    );
}

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten).
///
/// # Panics
/// If a slice has another length.
pub fn matmul_nt(isa: Isa, m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    check(m, n, k, a.len(), b.len(), c.len());
    if m < FEW_ROWS {
        return dot_products(isa, m, n, k, a, b, c);
    }
    product(isa, (m, n, k), a, c, |column, columns, to, width| {
        // SAFETY: rows `column .. column + columns` of `b`, and the panel that is being packed.
        isa.run(Interleave {
            from: b[column * k..].as_ptr(),
            plane: k,
            channels: columns,
            count: k,
            to: to.as_mut_ptr(),
            to_stride: width,
            block: width,
        });
    });
}

/// `c = a b`: `a` is `m x k`, `b` is `k x n`, `c` is `m x n` (overwritten).
///
/// # Panics
/// If a slice has another length.
pub fn matmul_nn(isa: Isa, m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    check(m, n, k, a.len(), b.len(), c.len());
    if m < FEW_ROWS {
        return in_place(isa, m, n, k, a, b, c);
    }
    product(isa, (m, n, k), a, c, |column, columns, to, width| {
        for (l, to) in to.chunks_exact_mut(width).enumerate() {
            to[..columns].copy_from_slice(&b[l * n + column..][..columns]);
            to[columns..].fill(0.0);
        }
    });
}

/// `pack(first column, columns, panel, width)` packs columns of the right matrix as `[k][width]`, zero from `columns` on.
fn product(
    isa: Isa,
    (m, n, k): (usize, usize, usize),
    a: &[f32],
    c: &mut [f32],
    pack: impl Fn(usize, usize, &mut [f32], usize) + Sync,
) {
    if m * n == 0 {
        return;
    }
    if k == 0 {
        return c.fill(0.0);
    }
    let lanes = isa.lanes();
    let chunk = (PACKED_BYTES / size_of::<f32>() / k / (2 * lanes)).max(1) * 2 * lanes;
    let out = SharedMut::new(c);
    with_pooled(|workspace| {
        for first in (0..n).step_by(chunk) {
            let columns = chunk.min(n - first);
            let shape = PanelShape::new(isa, columns.next_multiple_of(lanes));
            let packed = workspace.shared.floats(k * shape.columns());
            let shared = SharedMut::new(packed);
            for_each(&mut workspace.workers, 0, shape.count(), |_, panel| {
                let (start, width) = (shape.start(panel), shape.width(panel));
                // SAFETY: each panel is packed by one unit.
                let to = unsafe { std::slice::from_raw_parts_mut(shared.at(start * k), width * k) };
                pack(first + start, width.min(columns - start), to, width);
            });
            let packed = &*packed;
            let scratch_floats = ROW_BLOCK * shape.width(0);
            for_each(
                &mut workspace.workers,
                scratch_floats,
                m.div_ceil(ROW_BLOCK) * shape.count(),
                |scratch, unit| {
                    let (row, panel) = (unit / shape.count() * ROW_BLOCK, unit % shape.count());
                    let (start, width) = (shape.start(panel), shape.width(panel));
                    let (rows, inside) = (ROW_BLOCK.min(m - row), width.min(columns - start));
                    // SAFETY: rows of `a`, a packed panel; rows and columns of `c` that belong to this unit, or its
                    // scratch where the panel reaches over the last column.
                    unsafe {
                        let c = out.at(row * n + first + start);
                        let whole = inside == width;
                        isa.run(PanelRun {
                            a: a.as_ptr().add(row * k),
                            row_stride: k,
                            depth_stride: 1,
                            taps: Taps::ONE,
                            depth: k,
                            b: packed.as_ptr().add(start * k),
                            b_stride: width,
                            width,
                            out: if whole { c } else { scratch.as_mut_ptr() },
                            out_stride: if whole { n } else { width },
                            rows,
                            finish: Finish::Store,
                        });
                        if !whole {
                            for (r, line) in scratch.chunks_exact(width).take(rows).enumerate() {
                                std::ptr::copy_nonoverlapping(line.as_ptr(), c.add(r * n), inside);
                            }
                        }
                    }
                },
            );
        }
    });
}

/// [`matmul_nt`] for few rows of `a`: each row of `b` is read once, where it lies.
fn dot_products(isa: Isa, m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    let out = SharedMut::new(c);
    with_pooled(|workspace| {
        for_each(
            &mut workspace.workers,
            0,
            n.div_ceil(DOT_BLOCK),
            |_, block| {
                let first = block * DOT_BLOCK;
                isa.run(DotBlock {
                    m,
                    n,
                    k,
                    a,
                    b,
                    columns: first..n.min(first + DOT_BLOCK),
                    out,
                });
            },
        );
    });
}

/// [`matmul_nn`] for few rows of `a`: `b` is read once, where it lies.
fn in_place(isa: Isa, m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    let width = 2 * isa.lanes();
    let whole = n / width;
    let out = SharedMut::new(c);
    with_pooled(|workspace| {
        for_each(&mut workspace.workers, 0, whole, |_, panel| {
            // SAFETY: rows of `a`, whole vectors of the rows of `b`; columns of `c` that belong to this unit.
            unsafe {
                isa.run(PanelRun {
                    a: a.as_ptr(),
                    row_stride: k,
                    depth_stride: 1,
                    taps: Taps::ONE,
                    depth: k,
                    b: b.as_ptr().wrapping_add(panel * width),
                    b_stride: n,
                    width,
                    out: out.at(panel * width),
                    out_stride: n,
                    rows: m,
                    finish: Finish::Store,
                });
            }
        });
    });
    for i in 0..m {
        for j in whole * width..n {
            c[i * n + j] = (0..k).map(|l| a[i * k + l] * b[l * n + j]).sum();
        }
    }
}

/// `c[i][j]` for all rows `i` of `a` and `columns` `j`.
struct DotBlock<'a> {
    m: usize,
    n: usize,
    k: usize,
    a: &'a [f32],
    b: &'a [f32],
    columns: std::ops::Range<usize>,
    out: SharedMut,
}

impl Kernel for DotBlock<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        for j in self.columns.clone().step_by(4) {
            let mut i = 0;
            while i < self.m {
                if self.m - i >= 2 && self.columns.end - j >= 4 {
                    self.tile::<S, 2, 4>(simd, i, j);
                    i += 2;
                } else {
                    let columns = j..self.columns.end.min(j + 4);
                    if columns.len() == 4 {
                        self.tile::<S, 1, 4>(simd, i, j);
                    } else {
                        columns.for_each(|j| self.tile::<S, 1, 1>(simd, i, j));
                    }
                    i += 1;
                }
            }
        }
    }
}

impl DotBlock<'_> {
    /// `R x C` products from row `i`, column `j` on.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(&self, simd: S, i: usize, j: usize) {
        let k = self.k;
        let a: [&[f32]; R] = std::array::from_fn(|r| &self.a[(i + r) * k..][..k]);
        let b: [&[f32]; C] = std::array::from_fn(|c| &self.b[(j + c) * k..][..k]);
        let mut sums = [[simd.zero(); C]; R];
        let whole = k / S::LANES * S::LANES;
        for l in (0..whole).step_by(S::LANES) {
            // SAFETY: `l + LANES <= k`, the length of every row.
            let b: [S::V; C] = std::array::from_fn(|c| unsafe { simd.load(b[c].as_ptr().add(l)) });
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
                    .map(|(a, b)| a * b)
                    .sum();
                // SAFETY: an element of `c`, whose columns belong to this block.
                unsafe { *self.out.at((i + r) * self.n + j + c) = simd.sum(sum) + rest };
            }
        }
    }
}
