//! NEON.

use std::arch::aarch64::*;

use super::backend::simd_backend;

/// 4 floats per vector. Every 64-bit Arm processor has NEON.
#[derive(Clone, Copy)]
pub(crate) struct Neon(());

impl Neon {
    pub(crate) fn new() -> Self {
        Self(())
    }
}

simd_backend! {
    Neon, vector: float32x4_t, lanes: 4, mr: 12,
    features: "neon",
    splat: |value| vdupq_n_f32(value),
    add: |a, b| vaddq_f32(a, b),
    sub: |a, b| vsubq_f32(a, b),
    mul: |a, b| vmulq_f32(a, b),
    mul_add: |a, b, c| vfmaq_f32(c, a, b),
    neg_mul_add: |a, b, c| vfmsq_f32(c, a, b),
    max: |a, b| vmaxq_f32(a, b),
    sum: |a| vaddvq_f32(a),
    load: |from| vld1q_f32(from),
    load_f16: |from| vld1q_f32(from.cast::<[half::f16; 4]>().read().map(f32::from).as_ptr()),
    load_i8: |from| vld1q_f32(from.cast::<[i8; 4]>().read().map(f32::from).as_ptr()),
    store: |to, value| vst1q_f32(to, value),
    transpose: transpose_4x4,
}

/// Transposes 4 x 4 floats with NEON.
///
/// # Safety
/// As [`Simd::transpose`](super::Simd::transpose); the processor must have the instructions.
#[inline(always)]
unsafe fn transpose_4x4(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize) {
    // SAFETY: the caller's contract.
    unsafe {
        let r: [float32x4_t; 4] = std::array::from_fn(|i| vld1q_f32(from.add(i * from_stride)));
        let (a, b) = (vtrnq_f32(r[0], r[1]), vtrnq_f32(r[2], r[3]));
        vst1q_f32(to, vcombine_f32(vget_low_f32(a.0), vget_low_f32(b.0)));
        vst1q_f32(
            to.add(to_stride),
            vcombine_f32(vget_low_f32(a.1), vget_low_f32(b.1)),
        );
        vst1q_f32(
            to.add(2 * to_stride),
            vcombine_f32(vget_high_f32(a.0), vget_high_f32(b.0)),
        );
        vst1q_f32(
            to.add(3 * to_stride),
            vcombine_f32(vget_high_f32(a.1), vget_high_f32(b.1)),
        );
    }
}
