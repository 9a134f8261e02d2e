//! Plain Rust.

use super::{ByteDots, DotKernel};

/// Plain Rust, on every processor.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

const LANES: usize = 4;

impl ByteDots for Portable {
    type Sums = [i32; LANES];
    type Word = [i32; 4];
    type Weights = [[i32; LANES]; 4];
    const LANES: usize = LANES;
    const TILE: usize = 8;
    const OFFSET: i32 = 0;

    fn run<K: DotKernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }
    #[inline(always)]
    unsafe fn sums(self, from: *const i32) -> Self::Sums {
        // SAFETY: the caller's contract.
        unsafe { from.cast::<Self::Sums>().read() }
    }
    #[inline(always)]
    unsafe fn word(self, from: *const u8) -> Self::Word {
        // SAFETY: the caller's contract.
        unsafe { from.cast::<[u8; 4]>().read() }.map(i32::from)
    }
    #[inline(always)]
    unsafe fn weights(self, from: *const i8) -> Self::Weights {
        // SAFETY: the caller's contract.
        let lanes = unsafe { from.cast::<[[i8; 4]; LANES]>().read() };
        std::array::from_fn(|byte| lanes.map(|lane| i32::from(lane[byte])))
    }
    #[inline(always)]
    fn dot(self, mut sums: Self::Sums, word: Self::Word, weights: Self::Weights) -> Self::Sums {
        for (byte, weights) in word.iter().zip(weights) {
            for (sum, weight) in sums.iter_mut().zip(weights) {
                *sum = sum.wrapping_add(byte * weight);
            }
        }
        sums
    }
    #[inline(always)]
    unsafe fn store_bytes(self, to: *mut u8, sums: Self::Sums, factors: *const f32) {
        // SAFETY: the caller's contract.
        unsafe {
            let factors = factors.cast::<[f32; LANES]>().read();
            let bytes = std::array::from_fn::<u8, LANES, _>(|i| rounded_byte(sums[i], factors[i]));
            to.cast::<[u8; LANES]>().write(bytes);
        }
    }
    #[inline(always)]
    unsafe fn store_floats(self, to: *mut f32, sums: Self::Sums, factors: *const f32) {
        // SAFETY: the caller's contract.
        unsafe {
            let factors = factors.cast::<[f32; LANES]>().read();
            to.cast::<[f32; LANES]>()
                .write(std::array::from_fn(|i| sums[i] as f32 * factors[i]));
        }
    }
}

/// `max(sum, 0) * factor` as a byte, rounded to the nearest, ties to even, at most 255.
#[inline(always)]
fn rounded_byte(sum: i32, factor: f32) -> u8 {
    byte_from(sum.max(0) as f32 * factor)
}

/// A number as a byte, rounded to the nearest, ties to even, between 0 and 255.
#[inline(always)]
pub(crate) fn byte_from(value: f32) -> u8 {
    // Beyond 2^23 a float has no fraction, so that the sum is rounded and the integer is in its lowest bits.
    const ROUND: f32 = 8_388_608.0;
    let positive = if value > 0.0 { value } else { 0.0 };
    let limited = if positive < 255.0 { positive } else { 255.0 };
    (limited + ROUND).to_bits() as u8
}
