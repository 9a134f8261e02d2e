//! AVX-512 VNNI, AVX-VNNI and AVX2.

use std::arch::x86_64::*;

use super::{ByteDots, DotKernel};
use crate::Isa;

/// AVX-512 VNNI.
#[derive(Clone, Copy)]
pub(crate) struct Vnni512(());

impl Vnni512 {
    pub(crate) fn new() -> Option<Self> {
        let there = Isa::Avx512.is_available() && is_x86_feature_detected!("avx512vnni");
        there.then_some(Self(()))
    }
}

// SAFETY (of every block below): the token exists only where the processor has the instructions; memory is the caller's contract.
impl ByteDots for Vnni512 {
    type Sums = __m512i;
    type Word = __m512i;
    type Weights = __m512i;
    const LANES: usize = 16;
    const TILE: usize = 20;
    const OFFSET: i32 = 0;

    fn run<K: DotKernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx2,fma")]
        fn compiled<K: DotKernel>(dots: Vnni512, kernel: K) -> K::Output {
            kernel.run(dots)
        }
        // SAFETY: see above.
        unsafe { compiled(self, kernel) }
    }
    #[inline(always)]
    unsafe fn sums(self, from: *const i32) -> __m512i {
        // SAFETY: see above.
        unsafe { _mm512_loadu_si512(from.cast()) }
    }
    #[inline(always)]
    unsafe fn word(self, from: *const u8) -> __m512i {
        // SAFETY: see above.
        unsafe { _mm512_set1_epi32(from.cast::<i32>().read_unaligned()) }
    }
    #[inline(always)]
    unsafe fn weights(self, from: *const i8) -> __m512i {
        // SAFETY: see above.
        unsafe { _mm512_loadu_si512(from.cast()) }
    }
    #[inline(always)]
    fn dot(self, sums: __m512i, word: __m512i, weights: __m512i) -> __m512i {
        // SAFETY: see above.
        unsafe { _mm512_dpbusd_epi32(sums, word, weights) }
    }
    #[inline(always)]
    unsafe fn store_bytes(self, to: *mut u8, sums: __m512i, factors: *const f32) {
        // SAFETY: see above.
        unsafe {
            let positive = _mm512_max_epi32(sums, _mm512_setzero_si512());
            let scaled = _mm512_mul_ps(_mm512_cvtepi32_ps(positive), _mm512_loadu_ps(factors));
            // Beyond 32 bits the integer is 2^31, which saturates too.
            let bytes = _mm512_cvtusepi32_epi8(_mm512_cvtps_epi32(scaled));
            _mm_storeu_si128(to.cast(), bytes);
        }
    }
    #[inline(always)]
    unsafe fn store_floats(self, to: *mut f32, sums: __m512i, factors: *const f32) {
        // SAFETY: see above.
        unsafe {
            let scaled = _mm512_mul_ps(_mm512_cvtepi32_ps(sums), _mm512_loadu_ps(factors));
            _mm512_storeu_ps(to, scaled);
        }
    }
}

/// Stores a vector of 256 bits as bytes or floats: the same for AVX-VNNI and AVX2.
macro_rules! stores_of_256_bits {
    () => {
        #[inline(always)]
        unsafe fn sums(self, from: *const i32) -> __m256i {
            // SAFETY: see above.
            unsafe { _mm256_loadu_si256(from.cast()) }
        }
        #[inline(always)]
        unsafe fn store_bytes(self, to: *mut u8, sums: __m256i, factors: *const f32) {
            // SAFETY: see above.
            unsafe {
                let positive = _mm256_max_epi32(sums, _mm256_setzero_si256());
                let scaled = _mm256_mul_ps(_mm256_cvtepi32_ps(positive), _mm256_loadu_ps(factors));
                let whole = _mm256_cvtps_epi32(_mm256_min_ps(scaled, _mm256_set1_ps(255.0)));
                let (low, high) = (
                    _mm256_castsi256_si128(whole),
                    _mm256_extracti128_si256::<1>(whole),
                );
                let words = _mm_packus_epi32(low, high);
                _mm_storel_epi64(to.cast(), _mm_packus_epi16(words, words));
            }
        }
        #[inline(always)]
        unsafe fn store_floats(self, to: *mut f32, sums: __m256i, factors: *const f32) {
            // SAFETY: see above.
            unsafe {
                let scaled = _mm256_mul_ps(_mm256_cvtepi32_ps(sums), _mm256_loadu_ps(factors));
                _mm256_storeu_ps(to, scaled);
            }
        }
    };
}

/// AVX-VNNI.
#[derive(Clone, Copy)]
pub(crate) struct Vnni256(());

impl Vnni256 {
    pub(crate) fn new() -> Option<Self> {
        let there = Isa::Avx2.is_available() && is_x86_feature_detected!("avxvnni");
        there.then_some(Self(()))
    }
}

// SAFETY (of every block below): as above.
impl ByteDots for Vnni256 {
    type Sums = __m256i;
    type Word = __m256i;
    type Weights = __m256i;
    const LANES: usize = 8;
    const TILE: usize = 12;
    const OFFSET: i32 = 0;

    fn run<K: DotKernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avxvnni,avx2,fma")]
        fn compiled<K: DotKernel>(dots: Vnni256, kernel: K) -> K::Output {
            kernel.run(dots)
        }
        // SAFETY: see above.
        unsafe { compiled(self, kernel) }
    }
    #[inline(always)]
    unsafe fn word(self, from: *const u8) -> __m256i {
        // SAFETY: see above.
        unsafe { _mm256_set1_epi32(from.cast::<i32>().read_unaligned()) }
    }
    #[inline(always)]
    unsafe fn weights(self, from: *const i8) -> __m256i {
        // SAFETY: see above.
        unsafe { _mm256_loadu_si256(from.cast()) }
    }
    #[inline(always)]
    fn dot(self, sums: __m256i, word: __m256i, weights: __m256i) -> __m256i {
        // SAFETY: see above.
        unsafe { _mm256_dpbusd_avx_epi32(sums, word, weights) }
    }
    stores_of_256_bits!();
}

/// AVX2.
#[derive(Clone, Copy)]
pub(crate) struct Madd(());

impl Madd {
    pub(crate) fn new() -> Option<Self> {
        Isa::Avx2.is_available().then_some(Self(()))
    }
}

/// The first and third byte of each lane as 16-bit integers, and the second and fourth.
#[derive(Clone, Copy)]
pub(crate) struct Halves {
    even: __m256i,
    odd: __m256i,
}

// SAFETY (of every block below): as above.
impl ByteDots for Madd {
    type Sums = __m256i;
    type Word = Halves;
    type Weights = Halves;
    const LANES: usize = 8;
    const TILE: usize = 8;
    const OFFSET: i32 = 0;

    fn run<K: DotKernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "avx2,fma")]
        fn compiled<K: DotKernel>(dots: Madd, kernel: K) -> K::Output {
            kernel.run(dots)
        }
        // SAFETY: see above.
        unsafe { compiled(self, kernel) }
    }
    #[inline(always)]
    unsafe fn word(self, from: *const u8) -> Halves {
        // SAFETY: see above.
        unsafe {
            let word = _mm256_set1_epi32(from.cast::<i32>().read_unaligned());
            Halves {
                even: _mm256_and_si256(word, _mm256_set1_epi16(0xff)),
                odd: _mm256_srli_epi16::<8>(word),
            }
        }
    }
    #[inline(always)]
    unsafe fn weights(self, from: *const i8) -> Halves {
        // SAFETY: see above.
        unsafe {
            let bytes = _mm256_loadu_si256(from.cast());
            Halves {
                even: _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(bytes)),
                odd: _mm256_srai_epi16::<8>(bytes),
            }
        }
    }
    #[inline(always)]
    fn dot(self, sums: __m256i, word: Halves, weights: Halves) -> __m256i {
        // SAFETY: see above.
        unsafe {
            let even = _mm256_madd_epi16(word.even, weights.even);
            let odd = _mm256_madd_epi16(word.odd, weights.odd);
            _mm256_add_epi32(sums, _mm256_add_epi32(even, odd))
        }
    }
    stores_of_256_bits!();
}
