//! Products of 8-bit integer matrices: exact, in 32 bits.
//!
//! The right matrix is packed as for floats ([`crate::panel`]), but in *words*: the 32 bits whose products one lane of a
//! multiply-add instruction sums up. These are four bytes with AVX-512 VNNI, two 16-bit integers otherwise.

mod words;

use crate::Isa;
use crate::cache::l2_bytes;
use crate::matrix::{MatMut, MatRef, check_shapes};
use crate::parallel::{SharedMut, for_each};
use crate::workspace::with_pooled;
use words::{Tile, Words, with_words};

/// Rows of `a` that one task packs and one tile multiplies (mc).
const MC: usize = 96;
/// Columns that one task packs and multiplies (nc).
const NC: usize = 128;
/// Rows of the largest micro-tile of any instruction set.
const ROWS: usize = 12;
/// Eighths of the L2 cache that the sums of a block of rows take.
const CACHED_EIGHTHS: usize = 3;
/// Panels that one task packs.
const PANELS: usize = 8;

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten). Exact if `k <= 131,000`. Memory beside the operands
/// does not grow with `b`.
///
/// # Panics
/// If the shapes do not fit each other.
#[track_caller]
pub fn matmul_nt_i8(isa: Isa, a: MatRef<'_, i8>, b: MatRef<'_, i8>, c: MatMut<'_, i32>) {
    check_shapes(
        [a.rows(), a.cols()],
        [b.cols(), b.rows()],
        [c.rows(), c.cols()],
    );
    with_words!(isa, |words| by_columns(words, a, b, c));
}

/// [`matmul_nt_i8`] for many rows of `a`, with `c` without gaps between its rows. `finished` is called with the number of the first
/// row and the sums of each block of rows as soon as they are there and still in the cache: every row once, in any order, on any
/// thread of the pool.
///
/// # Panics
/// If the shapes do not fit each other.
#[track_caller]
pub fn matmul_nt_i8_by_rows(
    isa: Isa,
    a: MatRef<'_, i8>,
    b: MatRef<'_, i8>,
    c: &mut [i32],
    finished: impl Fn(usize, &[i32]) + Sync,
) {
    let out = MatRef::new(&*c, a.rows(), b.rows());
    check_shapes(
        [a.rows(), a.cols()],
        [b.cols(), b.rows()],
        [out.rows(), out.cols()],
    );
    with_words!(isa, |words| by_rows(words, a, b, c, finished));
}

/// Packs the rows of `b` from `first` on, at most a panel of them: the start of each sum, and then the words of all rows for
/// each step of the depth. Rows that are missing are zero.
fn pack<W: Words>(b: MatRef<'_, i8>, first: usize, panel: &mut [i32]) {
    let width = 2 * W::LANES;
    panel.fill(0);
    let (start, packed) = panel.split_at_mut(width);
    for j in 0..width.min(b.rows() - first) {
        let row = b.row(first + j);
        for (words, elements) in packed.chunks_exact_mut(width).zip(row.chunks(W::DEPTH)) {
            words[j] = W::b_word(elements);
        }
        if W::A_OFFSET != 0 {
            start[j] = -W::A_OFFSET * row.iter().map(|&v| i32::from(v)).sum::<i32>();
        }
    }
}

/// The words of rows of `a` from `first` on, as many as `to` has room for.
fn convert<W: Words>(a: MatRef<'_, i8>, first: usize, depth: usize, to: &mut [i32]) {
    for (i, to) in to.chunks_exact_mut(depth).enumerate() {
        to.iter_mut()
            .zip(a.row(first + i).chunks(W::DEPTH))
            .for_each(|(to, elements)| *to = W::a_word(elements));
    }
}

/// Where the sums of a panel go.
struct Sums {
    /// Those of the first row.
    start: *mut i32,
    /// Sums from the first of one row to that of the next.
    row_stride: usize,
    /// Columns of the panel that there are.
    columns: usize,
}

impl Sums {
    /// Fills them with the products of rows of words with a panel. `scratch` has room for so many rows of a whole panel.
    ///
    /// # Safety
    /// `columns` sums must be writable in each row, and no other thread may use them.
    unsafe fn fill<W: Words>(
        self,
        words: W,
        depth: usize,
        a: &[i32],
        panel: &[i32],
        scratch: &mut [i32],
    ) {
        let width = 2 * W::LANES;
        if self.columns == width {
            // SAFETY: the caller's contract.
            words.run(unsafe { Tile::new(depth, a, panel, self.start, self.row_stride) });
            return;
        }
        let scratch = &mut scratch[..a.len() / depth * width];
        // SAFETY: `scratch` has so many rows.
        words.run(unsafe { Tile::new(depth, a, panel, scratch.as_mut_ptr(), width) });
        for (r, line) in scratch.chunks_exact(width).enumerate() {
            // SAFETY: the caller's contract.
            unsafe {
                let to = self.start.add(r * self.row_stride);
                std::ptr::copy_nonoverlapping(line.as_ptr(), to, self.columns);
            }
        }
    }
}

/// Column blocks as tasks, for few rows of `a`: the words of `a` are kept, those of a block of `b` are packed by its task.
fn by_columns<W: Words>(words: W, a: MatRef<'_, i8>, b: MatRef<'_, i8>, mut c: MatMut<'_, i32>) {
    let (m, n, k) = (a.rows(), b.rows(), a.cols());
    if m * n == 0 {
        return;
    }
    if k == 0 {
        return c.fill(0);
    }
    let depth = k.div_ceil(W::DEPTH);
    let width = 2 * W::LANES;
    let out_stride = c.row_stride();
    let out: SharedMut = SharedMut::new(bytemuck::cast_slice_mut(c.data_mut()));
    with_pooled(|workspace| {
        let a_words = workspace.shared.floats(m * depth);
        let shared = SharedMut::new(a_words);
        for_each(&mut workspace.workers, 0, m.div_ceil(MC), |_, block| {
            let first = block * MC;
            let rows = MC.min(m - first);
            // SAFETY: rows of `a` that belong to this task.
            let to = unsafe {
                std::slice::from_raw_parts_mut(shared.at(first * depth).cast::<i32>(), rows * depth)
            };
            convert::<W>(a, first, depth, to);
        });
        let a_words: &[i32] = bytemuck::cast_slice(a_words);
        let panel_words = (depth + 1) * width;
        for_each(
            &mut workspace.workers,
            panel_words + MC * width,
            n.div_ceil(NC),
            |scratch, block| {
                let (panel, scratch) = bytemuck::cast_slice_mut(scratch).split_at_mut(panel_words);
                let end = n.min((block + 1) * NC);
                for column in (block * NC..end).step_by(width) {
                    pack::<W>(b, column, panel);
                    for (block, a) in a_words.chunks(MC * depth).enumerate() {
                        // SAFETY: columns of `c` that belong to this task.
                        unsafe {
                            let to = Sums {
                                start: out.at(block * MC * out_stride + column).cast(),
                                row_stride: out_stride,
                                columns: width.min(end - column),
                            };
                            to.fill(words, depth, a, panel, scratch);
                        }
                    }
                }
            },
        );
    });
}

/// Row blocks as tasks: all of `b` is packed, and each task converts its rows of `a`.
fn by_rows<W: Words>(
    words: W,
    a: MatRef<'_, i8>,
    b: MatRef<'_, i8>,
    c: &mut [i32],
    finished: impl Fn(usize, &[i32]) + Sync,
) {
    let (m, n, k) = (a.rows(), b.rows(), a.cols());
    if m * n == 0 {
        return;
    }
    if k == 0 {
        c.fill(0);
        return finished(0, c);
    }
    let depth = k.div_ceil(W::DEPTH);
    let width = 2 * W::LANES;
    let (panels, panel_words) = (n.div_ceil(width), (depth + 1) * width);
    // As many rows as stay in the cache until `finished` reads them.
    let cached_sums = l2_bytes() / 8 * CACHED_EIGHTHS / size_of::<i32>();
    let block_rows = (cached_sums / n / ROWS * ROWS).clamp(ROWS, MC);
    let out: SharedMut = SharedMut::new(bytemuck::cast_slice_mut(c));
    with_pooled(|workspace| {
        let packed = workspace.shared.floats(panels * panel_words);
        let shared = SharedMut::new(packed);
        for_each(
            &mut workspace.workers,
            0,
            panels.div_ceil(PANELS),
            |_, task| {
                for panel in task * PANELS..panels.min((task + 1) * PANELS) {
                    // SAFETY: panels that belong to this task.
                    let to = unsafe {
                        let start = shared.at(panel * panel_words).cast::<i32>();
                        std::slice::from_raw_parts_mut(start, panel_words)
                    };
                    pack::<W>(b, panel * width, to);
                }
            },
        );
        let packed: &[i32] = bytemuck::cast_slice(packed);
        for_each(
            &mut workspace.workers,
            block_rows * (depth + width),
            m.div_ceil(block_rows),
            |scratch, block| {
                let first = block * block_rows;
                let rows = block_rows.min(m - first);
                let (a_words, scratch) =
                    bytemuck::cast_slice_mut(scratch).split_at_mut(block_rows * depth);
                let a_words = &mut a_words[..rows * depth];
                convert::<W>(a, first, depth, a_words);
                for (i, panel) in packed.chunks_exact(panel_words).enumerate() {
                    let column = i * width;
                    // SAFETY: rows of `c` that belong to this task.
                    unsafe {
                        let to = Sums {
                            start: out.at(first * n + column).cast(),
                            row_stride: n,
                            columns: width.min(n - column),
                        };
                        to.fill(words, depth, a_words, panel, scratch);
                    }
                }
                // SAFETY: as above; nothing writes to them any more.
                finished(first, unsafe {
                    std::slice::from_raw_parts(out.at(first * n).cast::<i32>(), rows * n)
                });
            },
        );
    });
}
