//! AVX-512, and AVX2 with FMA and F16C.

use std::arch::x86_64::*;

use super::backend::simd_backend;
use crate::Isa;

/// 16 floats per vector. Exists only if the processor has AVX-512 F, BW, DQ and VL.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(());

impl Avx512 {
    pub(crate) fn new() -> Option<Self> {
        Isa::Avx512.is_available().then_some(Self(()))
    }
}

simd_backend! {
    Avx512, vector: __m512, lanes: 16, mr: 12,
    features: "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,f16c",
    splat: |value| _mm512_set1_ps(value),
    add: |a, b| _mm512_add_ps(a, b),
    sub: |a, b| _mm512_sub_ps(a, b),
    mul: |a, b| _mm512_mul_ps(a, b),
    mul_add: |a, b, c| _mm512_fmadd_ps(a, b, c),
    neg_mul_add: |a, b, c| _mm512_fnmadd_ps(a, b, c),
    max: |a, b| _mm512_max_ps(a, b),
    sum: |a| _mm512_reduce_add_ps(a),
    load: |from| _mm512_loadu_ps(from),
    load_f16: |from| _mm512_cvtph_ps(_mm256_loadu_si256(from.cast())),
    load_i8: |from| _mm512_cvtepi32_ps(_mm512_cvtepi8_epi32(_mm_loadu_si128(from.cast()))),
    store: |to, value| _mm512_storeu_ps(to, value),
    transpose: transpose_16x16,
}

/// Transposes 16 x 16 floats with AVX-512 F.
///
/// # Safety
/// As [`Simd::transpose`](super::Simd::transpose); the processor must have the instructions.
#[inline(always)]
unsafe fn transpose_16x16(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize) {
    // SAFETY: the caller's contract.
    unsafe {
        let mut r: [__m512; 16] =
            std::array::from_fn(|i| _mm512_loadu_ps(from.add(i * from_stride)));
        // Pairs of rows, then groups of four, within each 128-bit quarter.
        for i in (0..16).step_by(2) {
            (r[i], r[i + 1]) = (
                _mm512_unpacklo_ps(r[i], r[i + 1]),
                _mm512_unpackhi_ps(r[i], r[i + 1]),
            );
        }
        for i in (0..16).step_by(4) {
            let d: [__m512d; 4] = std::array::from_fn(|j| _mm512_castps_pd(r[i + j]));
            r[i] = _mm512_castpd_ps(_mm512_unpacklo_pd(d[0], d[2]));
            r[i + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(d[0], d[2]));
            r[i + 2] = _mm512_castpd_ps(_mm512_unpacklo_pd(d[1], d[3]));
            r[i + 3] = _mm512_castpd_ps(_mm512_unpackhi_pd(d[1], d[3]));
        }
        // r[4 g + j] now holds, in quarter q, column 4 q + j of rows 4 g .. 4 g + 3: transpose the quarters.
        for j in 0..4 {
            let low = _mm512_shuffle_f32x4::<0x88>(r[j], r[j + 4]);
            let high = _mm512_shuffle_f32x4::<0xdd>(r[j], r[j + 4]);
            let low2 = _mm512_shuffle_f32x4::<0x88>(r[j + 8], r[j + 12]);
            let high2 = _mm512_shuffle_f32x4::<0xdd>(r[j + 8], r[j + 12]);
            _mm512_storeu_ps(
                to.add(j * to_stride),
                _mm512_shuffle_f32x4::<0x88>(low, low2),
            );
            _mm512_storeu_ps(
                to.add((j + 4) * to_stride),
                _mm512_shuffle_f32x4::<0x88>(high, high2),
            );
            _mm512_storeu_ps(
                to.add((j + 8) * to_stride),
                _mm512_shuffle_f32x4::<0xdd>(low, low2),
            );
            _mm512_storeu_ps(
                to.add((j + 12) * to_stride),
                _mm512_shuffle_f32x4::<0xdd>(high, high2),
            );
        }
    }
}

/// 8 floats per vector. Exists only if the processor has AVX2, FMA and F16C.
#[derive(Clone, Copy)]
pub(crate) struct Avx2(());

impl Avx2 {
    pub(crate) fn new() -> Option<Self> {
        Isa::Avx2.is_available().then_some(Self(()))
    }
}

simd_backend! {
    Avx2, vector: __m256, lanes: 8, mr: 6,
    features: "avx2,fma,f16c",
    splat: |value| _mm256_set1_ps(value),
    add: |a, b| _mm256_add_ps(a, b),
    sub: |a, b| _mm256_sub_ps(a, b),
    mul: |a, b| _mm256_mul_ps(a, b),
    mul_add: |a, b, c| _mm256_fmadd_ps(a, b, c),
    neg_mul_add: |a, b, c| _mm256_fnmadd_ps(a, b, c),
    max: |a, b| _mm256_max_ps(a, b),
    sum: |a| {
        let four = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
        let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
        _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
    },
    load: |from| _mm256_loadu_ps(from),
    load_f16: |from| _mm256_cvtph_ps(_mm_loadu_si128(from.cast())),
    load_i8: |from| _mm256_cvtepi32_ps(_mm256_cvtepi8_epi32(_mm_loadl_epi64(from.cast()))),
    store: |to, value| _mm256_storeu_ps(to, value),
    transpose: transpose_8x8,
}

/// Transposes 8 x 8 floats with AVX.
///
/// # Safety
/// As [`Simd::transpose`](super::Simd::transpose); the processor must have the instructions.
#[inline(always)]
unsafe fn transpose_8x8(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize) {
    // SAFETY: the caller's contract.
    unsafe {
        let mut r: [__m256; 8] =
            std::array::from_fn(|i| _mm256_loadu_ps(from.add(i * from_stride)));
        // Pairs of rows, then groups of four, inside each 128-bit half.
        for i in (0..8).step_by(2) {
            (r[i], r[i + 1]) = (
                _mm256_unpacklo_ps(r[i], r[i + 1]),
                _mm256_unpackhi_ps(r[i], r[i + 1]),
            );
        }
        for i in (0..8).step_by(4) {
            let d: [__m256d; 4] = std::array::from_fn(|j| _mm256_castps_pd(r[i + j]));
            r[i] = _mm256_castpd_ps(_mm256_unpacklo_pd(d[0], d[2]));
            r[i + 1] = _mm256_castpd_ps(_mm256_unpackhi_pd(d[0], d[2]));
            r[i + 2] = _mm256_castpd_ps(_mm256_unpacklo_pd(d[1], d[3]));
            r[i + 3] = _mm256_castpd_ps(_mm256_unpackhi_pd(d[1], d[3]));
        }
        for j in 0..4 {
            _mm256_storeu_ps(
                to.add(j * to_stride),
                _mm256_permute2f128_ps::<0x20>(r[j], r[j + 4]),
            );
            _mm256_storeu_ps(
                to.add((j + 4) * to_stride),
                _mm256_permute2f128_ps::<0x31>(r[j], r[j + 4]),
            );
        }
    }
}
