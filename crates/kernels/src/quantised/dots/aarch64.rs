//! The dot-product extension of 64-bit Arm.

use std::arch::aarch64::*;
use std::arch::asm;

use super::{ByteDots, DotKernel};

/// `sdot`: products of signed bytes. Unsigned ones get 128 taken away.
#[derive(Clone, Copy)]
pub(crate) struct Sdot(());

impl Sdot {
    pub(crate) fn new() -> Option<Self> {
        std::arch::is_aarch64_feature_detected!("dotprod").then_some(Self(()))
    }
}

// SAFETY (of every block below): the token exists only where the processor has the instructions; memory is the caller's contract.
impl ByteDots for Sdot {
    type Sums = int32x4_t;
    type Word = int8x16_t;
    type Weights = int8x16_t;
    const LANES: usize = 4;
    const TILE: usize = 16;
    const OFFSET: i32 = -128;

    fn run<K: DotKernel>(self, kernel: K) -> K::Output {
        #[target_feature(enable = "neon,dotprod")]
        fn compiled<K: DotKernel>(dots: Sdot, kernel: K) -> K::Output {
            kernel.run(dots)
        }
        // SAFETY: see above.
        unsafe { compiled(self, kernel) }
    }
    #[inline(always)]
    unsafe fn sums(self, from: *const i32) -> int32x4_t {
        // SAFETY: see above.
        unsafe { vld1q_s32(from) }
    }
    #[inline(always)]
    unsafe fn word(self, from: *const u8) -> int8x16_t {
        // Flipping the sign bit takes 128 away.
        // SAFETY: see above.
        unsafe {
            let word = from.cast::<u32>().read_unaligned() ^ 0x8080_8080;
            vreinterpretq_s8_u32(vdupq_n_u32(word))
        }
    }
    #[inline(always)]
    unsafe fn weights(self, from: *const i8) -> int8x16_t {
        // SAFETY: see above.
        unsafe { vld1q_s8(from) }
    }
    #[inline(always)]
    fn dot(self, mut sums: int32x4_t, word: int8x16_t, weights: int8x16_t) -> int32x4_t {
        // The intrinsic `vdotq_s32` is not stable.
        // SAFETY: see above; the instruction only changes the register of the sums.
        unsafe {
            asm!(
                ".arch_extension dotprod",
                "sdot {sums:v}.4s, {word:v}.16b, {weights:v}.16b",
                sums = inout(vreg) sums,
                word = in(vreg) word,
                weights = in(vreg) weights,
                options(pure, nomem, nostack, preserves_flags)
            );
        }
        sums
    }
    #[inline(always)]
    unsafe fn store_bytes(self, to: *mut u8, sums: int32x4_t, factors: *const f32) {
        // SAFETY: see above.
        unsafe {
            let positive = vmaxq_s32(sums, vdupq_n_s32(0));
            let scaled = vmulq_f32(vcvtq_f32_s32(positive), vld1q_f32(factors));
            let whole = vcvtnq_u32_f32(vminq_f32(scaled, vdupq_n_f32(255.0)));
            let halves = vmovn_u32(whole);
            let bytes = vmovn_u16(vcombine_u16(halves, halves));
            to.cast::<u32>()
                .write_unaligned(vget_lane_u32::<0>(vreinterpret_u32_u8(bytes)));
        }
    }
    #[inline(always)]
    unsafe fn store_floats(self, to: *mut f32, sums: int32x4_t, factors: *const f32) {
        // SAFETY: see above.
        unsafe { vst1q_f32(to, vmulq_f32(vcvtq_f32_s32(sums), vld1q_f32(factors))) }
    }
}
