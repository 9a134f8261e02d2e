//! Products of `f32` matrices.
//!
//! Blocking as in BLIS (see [`crate::panel`]): nc columns of `b` are packed at a time ([`PACKED_BYTES`], last-level cache),
//! and [`MC`] rows of `a` are multiplied with one packed panel by one task (L2 cache).

use crate::Isa;
use crate::dot_products::matmul_nt_stored;
use crate::layout::{Interleave, InterleaveShape};
use crate::matrix::{MatMut, MatRef, check_shapes};
use crate::panel::{Finish, LeftRows, OutputRows, PanelProduct, PanelShape, RightPanel, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::workspace::with_pooled;

/// Size of the packed columns (nc) that are multiplied at a time: they should stay in the last-level cache.
const PACKED_BYTES: usize = 4 << 20;
/// Rows of `a` that one task multiplies (mc): a multiple of every micro-tile's rows.
const MC: usize = 96;
/// With fewer rows in `a`, packing `b` takes longer than it saves.
const FEW_ROWS: usize = 12;

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten).
///
/// # Panics
/// If the shapes do not fit each other.
#[track_caller]
pub fn matmul_nt(isa: Isa, a: MatRef<'_, f32>, b: MatRef<'_, f32>, c: MatMut<'_, f32>) {
    check_shapes(
        [a.rows(), a.cols()],
        [b.cols(), b.rows()],
        [c.rows(), c.cols()],
    );
    if a.rows() < FEW_ROWS {
        return matmul_nt_stored(isa, a, b, c);
    }
    product(isa, a, b.rows(), c, |column, columns, to, width| {
        let shape = InterleaveShape {
            plane: b.row_stride(),
            channels: columns,
            count: b.cols(),
            to_stride: width,
            block: width,
        };
        // SAFETY: rows `column .. column + columns` of `b`, each `k` floats, which are read; the panel of `k x width`
        // floats that is packed.
        isa.run(unsafe { Interleave::new(b.row_ptr(column), to.as_mut_ptr(), shape) });
    });
}

/// `c = a b`: `a` is `m x k`, `b` is `k x n`, `c` is `m x n` (overwritten).
///
/// # Panics
/// If the shapes do not fit each other.
#[track_caller]
pub fn matmul_nn(isa: Isa, a: MatRef<'_, f32>, b: MatRef<'_, f32>, c: MatMut<'_, f32>) {
    check_shapes(
        [a.rows(), a.cols()],
        [b.rows(), b.cols()],
        [c.rows(), c.cols()],
    );
    if a.rows() < FEW_ROWS {
        return in_place(isa, a, b, c);
    }
    product(isa, a, b.cols(), c, |column, columns, to, width| {
        for (l, to) in to.chunks_exact_mut(width).enumerate() {
            to[..columns].copy_from_slice(&b.row(l)[column..][..columns]);
            to[columns..].fill(0.0);
        }
    });
}

/// The product with packed columns. `pack(first column, columns, panel, width)` packs columns of the right matrix as
/// `[k][width]`, with zeros from `columns` on.
fn product(
    isa: Isa,
    a: MatRef<'_, f32>,
    n: usize,
    mut c: MatMut<'_, f32>,
    pack: impl Fn(usize, usize, &mut [f32], usize) + Sync,
) {
    let (m, k) = (a.rows(), a.cols());
    if m * n == 0 {
        return;
    }
    if k == 0 {
        return c.fill(0.0);
    }
    let lanes = isa.lanes();
    let nc = (PACKED_BYTES / size_of::<f32>() / k / (2 * lanes)).max(1) * 2 * lanes;
    let out_stride = c.row_stride();
    let out = SharedMut::new(c.data_mut());
    with_pooled(|workspace| {
        for first in (0..n).step_by(nc) {
            let columns = nc.min(n - first);
            let shape = PanelShape::new(isa, columns.next_multiple_of(lanes));
            let packed = workspace.shared.floats(k * shape.columns());
            let shared = SharedMut::new(packed);
            for_each(&mut workspace.workers, 0, shape.count(), |_, panel| {
                let (start, width) = (shape.start(panel), shape.width(panel));
                // SAFETY: each panel is packed by one task.
                let to = unsafe { std::slice::from_raw_parts_mut(shared.at(start * k), width * k) };
                pack(first + start, width.min(columns - start), to, width);
            });
            let packed = &*packed;
            let scratch_floats = MC * shape.width(0);
            for_each(
                &mut workspace.workers,
                scratch_floats,
                m.div_ceil(MC) * shape.count(),
                |scratch, task| {
                    let (row, panel) = (task / shape.count() * MC, task % shape.count());
                    let (start, width) = (shape.start(panel), shape.width(panel));
                    let (rows, inside) = (MC.min(m - row), width.min(columns - start));
                    let left = LeftRows {
                        start: a.row_ptr(row),
                        rows,
                        row_stride: a.row_stride(),
                        taps: Taps::ONE,
                        depth: k,
                        depth_stride: 1,
                    };
                    let right = RightPanel::packed(&packed[start * k..][..width * k], width);
                    // SAFETY: rows of `a`, a packed panel; rows and columns of `c` that belong to this task, or its
                    // scratch if the panel reaches beyond the last column.
                    unsafe {
                        let c = out.at(row * out_stride + first + start);
                        let whole = inside == width;
                        let to = if whole {
                            OutputRows {
                                start: c,
                                row_stride: out_stride,
                            }
                        } else {
                            OutputRows {
                                start: scratch.as_mut_ptr(),
                                row_stride: width,
                            }
                        };
                        isa.run(PanelProduct::new(left, right, to, Finish::Store));
                        if !whole {
                            for (r, line) in scratch.chunks_exact(width).take(rows).enumerate() {
                                let to = c.add(r * out_stride);
                                std::ptr::copy_nonoverlapping(line.as_ptr(), to, inside);
                            }
                        }
                    }
                },
            );
        }
    });
}

/// [`matmul_nn`] for few rows of `a`: `b` is read once and not packed.
fn in_place(isa: Isa, a: MatRef<'_, f32>, b: MatRef<'_, f32>, mut c: MatMut<'_, f32>) {
    let width = 2 * isa.lanes();
    let (n, k) = (b.cols(), a.cols());
    if a.rows() == 0 {
        // `c` has no column to point at.
        return;
    }
    let whole = n / width;
    let out_stride = c.row_stride();
    let out = SharedMut::new(c.data_mut());
    let left = |a: MatRef<'_, f32>| LeftRows {
        start: a.row_ptr(0),
        rows: a.rows(),
        row_stride: a.row_stride(),
        taps: Taps::ONE,
        depth: k,
        depth_stride: 1,
    };
    with_pooled(|workspace| {
        for_each(&mut workspace.workers, 0, whole, |_, panel| {
            let right = RightPanel {
                start: b.row_ptr(0).wrapping_add(panel * width),
                row_stride: b.row_stride(),
                width,
            };
            // SAFETY: rows of `a`, whole vectors of the rows of `b`; columns of `c` that belong to this task.
            unsafe {
                let to = OutputRows {
                    start: out.at(panel * width),
                    row_stride: out_stride,
                };
                isa.run(PanelProduct::new(left(a), right, to, Finish::Store));
            }
        });
    });
    for i in 0..a.rows() {
        for j in whole * width..n {
            c.row_mut(i)[j] = (0..k).map(|l| a.row(i)[l] * b.row(l)[j]).sum();
        }
    }
}
