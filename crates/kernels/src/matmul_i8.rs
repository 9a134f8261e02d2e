//! Products of 8-bit integer matrices: exact, in 32 bits.
//!
//! The right matrix is packed as for floats ([`crate::panel`]), but in *words*: the 32 bits that one lane of a
//! multiply-add instruction sums up. They are four bytes with AVX-512 VNNI, two 16-bit integers elsewhere.

use crate::Isa;
use crate::parallel::{SharedMut, for_each};
use crate::workspace::with_pooled;

/// Rows of `a` in a piece of work.
const ROW_BLOCK: usize = 96;
/// Columns in a piece of work.
const COLUMN_BLOCK: usize = 128;

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten). Exact while `k <= 131,000`.
///
/// # Panics
/// If a slice has another length.
pub fn matmul_nt_i8(isa: Isa, m: usize, n: usize, k: usize, a: &[i8], b: &[i8], c: &mut [i32]) {
    assert_eq!(
        (a.len(), b.len(), c.len()),
        (m * k, n * k, m * n),
        "elements of a, b and c for m={m}, n={n}, k={k}"
    );
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(words) = x86::Vnni::new(isa) {
            return product(words, (m, n, k), a, b, c);
        }
        if let Some(words) = x86::Madd::new(isa) {
            return product(words, (m, n, k), a, b, c);
        }
    }
    let _ = isa;
    product(Portable, (m, n, k), a, b, c);
}

/// Lanes of 32-bit sums of products of words.
trait Words: Copy + Send + Sync {
    type V: Copy;
    /// Sums in a vector.
    const LANES: usize;
    /// Rows of two vectors that fit in the registers.
    const ROWS: usize;
    /// Elements in a word.
    const DEPTH: usize;
    /// What is added to the elements of `a`.
    const A_OFFSET: i32;

    fn run(self, tile: Tile<'_>);
    /// A word of up to `DEPTH` elements of `a` (offset included) or of `b`.
    fn a_word(elements: &[i8]) -> i32;
    fn b_word(elements: &[i8]) -> i32;
    fn splat(self, word: i32) -> Self::V;
    /// `sum + a . b`
    fn dot(self, sum: Self::V, a: Self::V, b: Self::V) -> Self::V;
    /// # Safety
    /// `LANES` words must be readable at `from`.
    unsafe fn load(self, from: *const i32) -> Self::V;
    /// # Safety
    /// `LANES` words must be writable at `to`.
    unsafe fn store(self, to: *mut i32, sums: Self::V);
}

fn product<W: Words>(
    words: W,
    (m, n, k): (usize, usize, usize),
    a: &[i8],
    b: &[i8],
    c: &mut [i32],
) {
    if m * n == 0 {
        return;
    }
    if k == 0 {
        return c.fill(0);
    }
    let depth = k.div_ceil(W::DEPTH);
    let width = 2 * W::LANES;
    let out = SharedMut::new(bytemuck::cast_slice_mut(c));
    with_pooled(|workspace| {
        let a_words = workspace.shared.floats(m * depth);
        let shared = SharedMut::new(a_words);
        for_each(
            &mut workspace.workers,
            0,
            m.div_ceil(ROW_BLOCK),
            |_, block| {
                let first = block * ROW_BLOCK;
                let rows = ROW_BLOCK.min(m - first);
                // SAFETY: rows of `a` that belong to this unit.
                let to = unsafe {
                    std::slice::from_raw_parts_mut(
                        shared.at(first * depth).cast::<i32>(),
                        rows * depth,
                    )
                };
                for (to, row) in to
                    .chunks_exact_mut(depth)
                    .zip(a[first * k..].chunks_exact(k))
                {
                    to.iter_mut()
                        .zip(row.chunks(W::DEPTH))
                        .for_each(|(to, elements)| *to = W::a_word(elements));
                }
            },
        );
        let a_words: &[i32] = bytemuck::cast_slice(a_words);
        // Packed columns, the correction for the offset of `a`, and sums that do not fit into `c`.
        let scratch_words = COLUMN_BLOCK * depth + width + ROW_BLOCK * width;
        for_each(
            &mut workspace.workers,
            scratch_words,
            n.div_ceil(COLUMN_BLOCK),
            |scratch, block| {
                let (packed, rest) =
                    bytemuck::cast_slice_mut(scratch).split_at_mut(COLUMN_BLOCK * depth);
                let (start, sums) = rest.split_at_mut(width);
                let end = n.min((block + 1) * COLUMN_BLOCK);
                for column in (block * COLUMN_BLOCK..end).step_by(width) {
                    let columns = width.min(end - column);
                    let panel = &mut packed[..width * depth];
                    panel.fill(0);
                    start.fill(0);
                    for (j, row) in b[column * k..].chunks_exact(k).take(columns).enumerate() {
                        for (word, elements) in row.chunks(W::DEPTH).enumerate() {
                            panel[word * width + j] = W::b_word(elements);
                        }
                        if W::A_OFFSET != 0 {
                            start[j] =
                                -W::A_OFFSET * row.iter().map(|&v| i32::from(v)).sum::<i32>();
                        }
                    }
                    for (block, a) in a_words.chunks(ROW_BLOCK * depth).enumerate() {
                        words.run(Tile {
                            depth,
                            a,
                            b: panel,
                            start,
                            out: sums,
                        });
                        for (r, line) in sums.chunks_exact(width).take(a.len() / depth).enumerate()
                        {
                            // SAFETY: columns of `c` that belong to this unit.
                            unsafe {
                                let to = out.at((block * ROW_BLOCK + r) * n + column).cast::<i32>();
                                std::ptr::copy_nonoverlapping(line.as_ptr(), to, columns);
                            }
                        }
                    }
                }
            },
        );
    });
}

/// Rows of words against a packed panel of two vectors: `out[r][j] = start[j] + a[r] . b[j]`.
struct Tile<'a> {
    depth: usize,
    /// `[row][depth]`
    a: &'a [i32],
    /// `[depth][2 * LANES]`
    b: &'a [i32],
    /// `[2 * LANES]`
    start: &'a [i32],
    /// `[row][2 * LANES]`
    out: &'a mut [i32],
}

impl Tile<'_> {
    #[inline(always)]
    fn all<W: Words>(self, words: W) {
        let (width, rows) = (2 * W::LANES, self.a.len() / self.depth);
        assert!(
            self.b.len() >= self.depth * width
                && self.start.len() >= width
                && self.out.len() >= rows * width
        );
        let mut row = 0;
        while row < rows {
            let a = self.a[row * self.depth..].as_ptr();
            let out = self.out[row * width..].as_mut_ptr();
            // SAFETY: as many rows as are left; the lengths are asserted above.
            row += unsafe {
                match rows - row {
                    12.. if W::ROWS >= 12 => self.rows::<W, 12>(words, a, out),
                    6.. => self.rows::<W, 6>(words, a, out),
                    3.. => self.rows::<W, 3>(words, a, out),
                    _ => self.rows::<W, 1>(words, a, out),
                }
            };
        }
    }

    /// # Safety
    /// `R` rows must be readable at `a` and writable at `out`.
    #[inline(always)]
    unsafe fn rows<W: Words, const R: usize>(
        &self,
        words: W,
        a: *const i32,
        out: *mut i32,
    ) -> usize {
        // SAFETY: the caller's promise, and the lengths asserted in `all`.
        unsafe {
            let mut sums = [[
                words.load(self.start.as_ptr()),
                words.load(self.start.as_ptr().add(W::LANES)),
            ]; R];
            let mut b = self.b.as_ptr();
            for d in 0..self.depth {
                let columns = [words.load(b), words.load(b.add(W::LANES))];
                for (r, sums) in sums.iter_mut().enumerate() {
                    let a = words.splat(*a.add(r * self.depth + d));
                    for (sum, &column) in sums.iter_mut().zip(&columns) {
                        *sum = words.dot(*sum, a, column);
                    }
                }
                b = b.add(2 * W::LANES);
            }
            for (r, sums) in sums.iter().enumerate() {
                for (j, &sum) in sums.iter().enumerate() {
                    words.store(out.add((2 * r + j) * W::LANES), sum);
                }
            }
        }
        R
    }
}

/// Two 16-bit integers as a word, the first in the low half.
fn pair(elements: &[i8]) -> i32 {
    let half = |i: usize| i32::from(elements.get(i).copied().unwrap_or(0));
    (half(1) << 16) | (half(0) & 0xffff)
}

#[derive(Clone, Copy)]
struct Portable;

impl Words for Portable {
    type V = [i32; 4];
    const LANES: usize = 4;
    const ROWS: usize = 6;
    const DEPTH: usize = 2;
    const A_OFFSET: i32 = 0;

    fn run(self, tile: Tile<'_>) {
        tile.all(self);
    }
    fn a_word(elements: &[i8]) -> i32 {
        pair(elements)
    }
    fn b_word(elements: &[i8]) -> i32 {
        pair(elements)
    }
    #[inline(always)]
    fn splat(self, word: i32) -> Self::V {
        [word; 4]
    }
    #[inline(always)]
    fn dot(self, sum: Self::V, a: Self::V, b: Self::V) -> Self::V {
        let low = |word: i32| i32::from(word as i16);
        std::array::from_fn(|i| sum[i] + low(a[i]) * low(b[i]) + (a[i] >> 16) * (b[i] >> 16))
    }
    #[inline(always)]
    unsafe fn load(self, from: *const i32) -> Self::V {
        // SAFETY: the caller's promise.
        unsafe { from.cast::<[i32; 4]>().read() }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut i32, sums: Self::V) {
        // SAFETY: the caller's promise.
        unsafe { to.cast::<[i32; 4]>().write(sums) }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{Tile, Words, pair};
    use crate::Isa;

    /// AVX2: products of 16-bit pairs.
    #[derive(Clone, Copy)]
    pub(super) struct Madd(());

    impl Madd {
        pub(super) fn new(isa: Isa) -> Option<Self> {
            (matches!(isa, Isa::Avx2 | Isa::Avx512) && Isa::Avx2.is_available()).then_some(Self(()))
        }
    }

    impl Words for Madd {
        type V = __m256i;
        const LANES: usize = 8;
        const ROWS: usize = 6;
        const DEPTH: usize = 2;
        const A_OFFSET: i32 = 0;

        fn run(self, tile: Tile<'_>) {
            #[target_feature(enable = "avx2")]
            fn compiled(words: Madd, tile: Tile<'_>) {
                tile.all(words);
            }
            // SAFETY: the token exists only where the processor has AVX2; so for all below.
            unsafe { compiled(self, tile) }
        }
        fn a_word(elements: &[i8]) -> i32 {
            pair(elements)
        }
        fn b_word(elements: &[i8]) -> i32 {
            pair(elements)
        }
        #[inline(always)]
        fn splat(self, word: i32) -> Self::V {
            // SAFETY: see `run`.
            unsafe { _mm256_set1_epi32(word) }
        }
        #[inline(always)]
        fn dot(self, sum: Self::V, a: Self::V, b: Self::V) -> Self::V {
            // SAFETY: see `run`.
            unsafe { _mm256_add_epi32(sum, _mm256_madd_epi16(a, b)) }
        }
        #[inline(always)]
        unsafe fn load(self, from: *const i32) -> Self::V {
            // SAFETY: see `run`; the memory is the caller's promise.
            unsafe { _mm256_loadu_si256(from.cast()) }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut i32, sums: Self::V) {
            // SAFETY: see `run`; the memory is the caller's promise.
            unsafe { _mm256_storeu_si256(to.cast(), sums) }
        }
    }

    /// AVX-512 VNNI: products of four unsigned by four signed bytes. `a` is made unsigned by adding 128.
    #[derive(Clone, Copy)]
    pub(super) struct Vnni(());

    impl Vnni {
        pub(super) fn new(isa: Isa) -> Option<Self> {
            let there =
                isa == Isa::Avx512 && isa.is_available() && is_x86_feature_detected!("avx512vnni");
            there.then_some(Self(()))
        }
    }

    /// Four bytes as a word, zero where there are fewer.
    fn four(elements: &[i8]) -> [u8; 4] {
        let mut bytes = [0; 4];
        bytes[..elements.len()].copy_from_slice(bytemuck::cast_slice(elements));
        bytes
    }

    impl Words for Vnni {
        type V = __m512i;
        const LANES: usize = 16;
        const ROWS: usize = 12;
        const DEPTH: usize = 4;
        const A_OFFSET: i32 = 128;

        fn run(self, tile: Tile<'_>) {
            #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
            fn compiled(words: Vnni, tile: Tile<'_>) {
                tile.all(words);
            }
            // SAFETY: the token exists only where the processor has these features; so for all below.
            unsafe { compiled(self, tile) }
        }
        fn a_word(elements: &[i8]) -> i32 {
            // Flipping the sign bit adds 128. Where `a` ends early, `b` is zero.
            i32::from_le_bytes(four(elements)) ^ i32::from_le_bytes([0x80; 4])
        }
        fn b_word(elements: &[i8]) -> i32 {
            i32::from_le_bytes(four(elements))
        }
        #[inline(always)]
        fn splat(self, word: i32) -> Self::V {
            // SAFETY: see `run`.
            unsafe { _mm512_set1_epi32(word) }
        }
        #[inline(always)]
        fn dot(self, sum: Self::V, a: Self::V, b: Self::V) -> Self::V {
            // SAFETY: see `run`.
            unsafe { _mm512_dpbusd_epi32(sum, a, b) }
        }
        #[inline(always)]
        unsafe fn load(self, from: *const i32) -> Self::V {
            // SAFETY: see `run`; the memory is the caller's promise.
            unsafe { _mm512_loadu_si512(from.cast()) }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut i32, sums: Self::V) {
            // SAFETY: see `run`; the memory is the caller's promise.
            unsafe { _mm512_storeu_si512(to.cast(), sums) }
        }
    }
}
