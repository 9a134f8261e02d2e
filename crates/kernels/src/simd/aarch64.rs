//! NEON.

use std::arch::aarch64::*;

use super::{Kernel, Simd};

/// Four floats at a time.
#[derive(Clone, Copy)]
pub(crate) struct Neon(());

impl Neon {
    /// Every 64-bit Arm has NEON.
    pub(crate) fn new() -> Self {
        Self(())
    }
}

impl Simd for Neon {
    type V = float32x4_t;
    const LANES: usize = 4;
    const ROWS: usize = 12;

    #[inline(always)]
    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "neon")]
        fn compiled<K: Kernel>(simd: Neon, kernel: K) -> K::Output {
            kernel.run(simd)
        }
        // SAFETY: every aarch64 processor has NEON.
        unsafe { compiled(self, kernel) }
    }
    #[inline(always)]
    fn zero(self) -> Self::V {
        // SAFETY: every aarch64 processor has NEON; so for all below.
        unsafe { vdupq_n_f32(0.0) }
    }
    #[inline(always)]
    fn splat(self, value: f32) -> Self::V {
        // SAFETY: see `zero`.
        unsafe { vdupq_n_f32(value) }
    }
    #[inline(always)]
    fn add(self, a: Self::V, b: Self::V) -> Self::V {
        // SAFETY: see `zero`.
        unsafe { vaddq_f32(a, b) }
    }
    #[inline(always)]
    fn sub(self, a: Self::V, b: Self::V) -> Self::V {
        // SAFETY: see `zero`.
        unsafe { vsubq_f32(a, b) }
    }
    #[inline(always)]
    fn mul(self, a: Self::V, b: Self::V) -> Self::V {
        // SAFETY: see `zero`.
        unsafe { vmulq_f32(a, b) }
    }
    #[inline(always)]
    fn mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        // SAFETY: see `zero`.
        unsafe { vfmaq_f32(c, a, b) }
    }
    #[inline(always)]
    fn neg_mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        // SAFETY: see `zero`.
        unsafe { vfmsq_f32(c, a, b) }
    }
    #[inline(always)]
    fn max(self, a: Self::V, b: Self::V) -> Self::V {
        // SAFETY: see `zero`.
        unsafe { vmaxq_f32(a, b) }
    }
    #[inline(always)]
    fn sum(self, a: Self::V) -> f32 {
        // SAFETY: see `zero`.
        unsafe { vaddvq_f32(a) }
    }
    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> Self::V {
        // SAFETY: see `zero`; the memory is the caller's promise.
        unsafe { vld1q_f32(from) }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32, value: Self::V) {
        // SAFETY: see `zero`; the memory is the caller's promise.
        unsafe { vst1q_f32(to, value) }
    }
    #[inline(always)]
    unsafe fn transpose(
        self,
        from: *const f32,
        from_stride: usize,
        to: *mut f32,
        to_stride: usize,
    ) {
        // SAFETY: see `zero`; the memory is the caller's promise.
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
}
