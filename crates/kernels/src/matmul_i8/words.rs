//! Multiply-add instructions on words of bytes, and the micro-kernel that is written with them.

/// Calls a function with the [`Words`] of an instruction set.
macro_rules! with_words {
    ($isa:expr, |$words:ident| $call:expr) => {{
        #[cfg(target_arch = "x86_64")]
        {
            if let Some($words) = words::x86::Vnni::new($isa) {
                return $call;
            }
            if let Some($words) = words::x86::Madd::new($isa) {
                return $call;
            }
        }
        let _ = $isa;
        let $words = words::Portable;
        $call
    }};
}

pub(super) use with_words;

/// Lanes of 32-bit sums of products of words.
pub(super) trait Words: Copy + Send + Sync {
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

/// Rows of words against a packed panel of two vectors: `out[r][j] = start[j] + a[r] . b[j]`.
pub(super) struct Tile<'a> {
    depth: usize,
    /// `[row][depth]`
    a: &'a [i32],
    /// The starts of the sums `[2 * LANES]`, and then the columns `[depth][2 * LANES]`.
    panel: &'a [i32],
    /// The first of `2 * LANES` sums of the first row.
    out: *mut i32,
    /// Sums from the first of one row to that of the next.
    out_stride: usize,
}

impl<'a> Tile<'a> {
    /// # Safety
    /// Until the tile has run, `2 * LANES` sums must be writable at `out` and at each of the further rows, `out_stride` apart,
    /// and no other thread may use them.
    pub unsafe fn new(
        depth: usize,
        a: &'a [i32],
        panel: &'a [i32],
        out: *mut i32,
        out_stride: usize,
    ) -> Self {
        Self {
            depth,
            a,
            panel,
            out,
            out_stride,
        }
    }

    #[inline(always)]
    fn all<W: Words>(self, words: W) {
        let rows = self.a.len() / self.depth;
        assert!(self.panel.len() >= (self.depth + 1) * 2 * W::LANES);
        let mut row = 0;
        while row < rows {
            let a = self.a[row * self.depth..].as_ptr();
            // SAFETY: no more rows than are left, see `new`; the length of the panel is asserted above.
            row += unsafe {
                let out = self.out.add(row * self.out_stride);
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
        // SAFETY: the caller's contract, and the length asserted in `all`.
        unsafe {
            let start = self.panel.as_ptr();
            let mut sums = [[words.load(start), words.load(start.add(W::LANES))]; R];
            let mut b = start.add(2 * W::LANES);
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
                    words.store(out.add(r * self.out_stride + j * W::LANES), sum);
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
pub(super) struct Portable;

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
pub(super) mod x86 {
    use std::arch::x86_64::*;

    use super::{Tile, Words, pair};
    use crate::Isa;

    /// AVX2: products of 16-bit pairs.
    #[derive(Clone, Copy)]
    pub(crate) struct Madd(());

    impl Madd {
        pub(crate) fn new(isa: Isa) -> Option<Self> {
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
    pub(crate) struct Vnni(());

    impl Vnni {
        pub(crate) fn new(isa: Isa) -> Option<Self> {
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
