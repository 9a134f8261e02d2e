//! Products of 8-bit integer matrices: exact, in 32 bits.
//!
//! The right matrix is packed as for floats ([`crate::panel`]), but in *words*: the 32 bits whose products one lane of a
//! multiply-add instruction sums up. These are four bytes with AVX-512 VNNI, two 16-bit integers otherwise.

use crate::Isa;
use crate::matmul::check_shapes;
use crate::matrix::{MatMut, MatRef};
use crate::parallel::{SharedMut, for_each};
use crate::workspace::with_pooled;

/// Rows of `a` that one task packs and one tile multiplies (mc).
const MC: usize = 96;
/// Columns that one task packs and multiplies (nc).
const NC: usize = 128;

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten). Exact if `k <= 131,000`.
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
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(words) = x86::Vnni::new(isa) {
            return product(words, a, b, c);
        }
        if let Some(words) = x86::Madd::new(isa) {
            return product(words, a, b, c);
        }
    }
    let _ = isa;
    product(Portable, a, b, c);
}

/// Lanes of 32-bit sums of products of words.
trait Words: Copy + Send + Sync {
    type V: Copy;
    /// Sums in a vector.
    const LANES: usize;
    /// Rows of the largest micro-tile (mr): `MR` rows of two vectors are kept in registers.
    const MR: usize;
    /// Elements in a word.
    const DEPTH: usize;
    /// Added to the elements of `a`, and corrected for at the start of the sums.
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

fn product<W: Words>(words: W, a: MatRef<'_, i8>, b: MatRef<'_, i8>, mut c: MatMut<'_, i32>) {
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
    let out = SharedMut::new(bytemuck::cast_slice_mut(c.data_mut()));
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
            for (i, to) in to.chunks_exact_mut(depth).enumerate() {
                to.iter_mut()
                    .zip(a.row(first + i).chunks(W::DEPTH))
                    .for_each(|(to, elements)| *to = W::a_word(elements));
            }
        });
        let a_words: &[i32] = bytemuck::cast_slice(a_words);
        // Packed columns, the correction for the offset of `a`, and sums that do not fit into `c`.
        let scratch_words = NC * depth + width + MC * width;
        for_each(
            &mut workspace.workers,
            scratch_words,
            n.div_ceil(NC),
            |scratch, block| {
                let (packed, rest) = bytemuck::cast_slice_mut(scratch).split_at_mut(NC * depth);
                let (start, sums) = rest.split_at_mut(width);
                let end = n.min((block + 1) * NC);
                for column in (block * NC..end).step_by(width) {
                    let columns = width.min(end - column);
                    let panel = &mut packed[..width * depth];
                    panel.fill(0);
                    start.fill(0);
                    for j in 0..columns {
                        let row = b.row(column + j);
                        for (word, elements) in row.chunks(W::DEPTH).enumerate() {
                            panel[word * width + j] = W::b_word(elements);
                        }
                        if W::A_OFFSET != 0 {
                            start[j] =
                                -W::A_OFFSET * row.iter().map(|&v| i32::from(v)).sum::<i32>();
                        }
                    }
                    for (block, a) in a_words.chunks(MC * depth).enumerate() {
                        words.run(Tile {
                            depth,
                            a,
                            b: panel,
                            start,
                            out: sums,
                        });
                        for (r, line) in sums.chunks_exact(width).take(a.len() / depth).enumerate()
                        {
                            // SAFETY: columns of `c` that belong to this task.
                            unsafe {
                                let to =
                                    out.at((block * MC + r) * out_stride + column).cast::<i32>();
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
            // SAFETY: no more rows than are left; the lengths are asserted above.
            row += unsafe {
                match rows - row {
                    12.. if W::MR >= 12 => self.rows::<W, 12>(words, a, out),
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
        // SAFETY: the caller's contract, and the lengths asserted in `all`.
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
#[inline(always)]
fn pair(elements: &[i8]) -> i32 {
    let half = |i: usize| i32::from(elements.get(i).copied().unwrap_or(0));
    (half(1) << 16) | (half(0) & 0xffff)
}

#[derive(Clone, Copy)]
struct Portable;

impl Words for Portable {
    type V = [i32; 4];
    const LANES: usize = 4;
    const MR: usize = 6;
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
        // SAFETY: the caller's contract.
        unsafe { from.cast::<[i32; 4]>().read() }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut i32, sums: Self::V) {
        // SAFETY: the caller's contract.
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
        const MR: usize = 6;
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
        #[inline(always)]
        fn a_word(elements: &[i8]) -> i32 {
            pair(elements)
        }
        #[inline(always)]
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
            // SAFETY: see `run`; the memory is the caller's contract.
            unsafe { _mm256_loadu_si256(from.cast()) }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut i32, sums: Self::V) {
            // SAFETY: see `run`; the memory is the caller's contract.
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
    #[inline(always)]
    fn four(elements: &[i8]) -> [u8; 4] {
        // All words but a row's last one, without a call that copies.
        if let Some(whole) = elements.first_chunk::<4>() {
            return whole.map(i8::cast_unsigned);
        }
        let mut bytes = [0; 4];
        bytes[..elements.len()].copy_from_slice(bytemuck::cast_slice(elements));
        bytes
    }

    impl Words for Vnni {
        type V = __m512i;
        const LANES: usize = 16;
        const MR: usize = 12;
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
        #[inline(always)]
        fn a_word(elements: &[i8]) -> i32 {
            // Flipping the sign bit adds 128. Where `a` ends early, `b` is zero.
            i32::from_le_bytes(four(elements)) ^ i32::from_le_bytes([0x80; 4])
        }
        #[inline(always)]
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
            // SAFETY: see `run`; the memory is the caller's contract.
            unsafe { _mm512_loadu_si512(from.cast()) }
        }
        #[inline(always)]
        unsafe fn store(self, to: *mut i32, sums: Self::V) {
            // SAFETY: see `run`; the memory is the caller's contract.
            unsafe { _mm512_storeu_si512(to.cast(), sums) }
        }
    }
}
