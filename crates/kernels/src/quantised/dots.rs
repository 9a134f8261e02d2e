//! Dot products of four unsigned and four signed bytes in each lane, for each instruction set.

#[cfg(target_arch = "aarch64")]
mod aarch64;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

use crate::Isa;
use portable::Portable;

pub(super) use portable::byte_from;

/// Code to be compiled for each set of instructions.
pub(super) trait DotKernel {
    type Output;
    /// Must be `#[inline(always)]`, and so must be every function that it calls.
    fn run<D: ByteDots>(self, dots: D) -> Self::Output;
}

/// Vectors of 32-bit sums of products of bytes. A value of an implementing type exists only if the processor has the
/// instructions.
pub(super) trait ByteDots: Copy + Send + Sync {
    /// `LANES` sums.
    type Sums: Copy;
    /// Four unsigned bytes, for all lanes.
    type Word: Copy;
    /// Four signed bytes for each lane.
    type Weights: Copy;
    /// Sums in a vector: at most 16, and a divisor of it.
    const LANES: usize;
    /// Vectors of sums in the largest micro-tile: what registers have room for beside weights, a word and addresses. (24 vectors of
    /// AVX-512 are spilled, at half the speed.)
    const TILE: usize;
    /// Added to the unsigned bytes by [`ByteDots::word`], and corrected for at the start of the sums.
    const OFFSET: i32;

    /// Runs a kernel compiled with these instructions.
    fn run<K: DotKernel>(self, kernel: K) -> K::Output;
    /// # Safety
    /// `LANES` sums must be readable at `from`.
    unsafe fn sums(self, from: *const i32) -> Self::Sums;
    /// # Safety
    /// Four bytes must be readable at `from`.
    unsafe fn word(self, from: *const u8) -> Self::Word;
    /// # Safety
    /// `4 * LANES` bytes must be readable at `from`.
    unsafe fn weights(self, from: *const i8) -> Self::Weights;
    /// Adds the products of a word to each sum.
    fn dot(self, sums: Self::Sums, word: Self::Word, weights: Self::Weights) -> Self::Sums;
    /// Stores `max(sum, 0) * factor` as bytes, rounded to the nearest, ties to even, at most 255.
    ///
    /// # Safety
    /// `LANES` bytes must be writable at `to`, and so many factors readable, each of them 0 or more.
    unsafe fn store_bytes(self, to: *mut u8, sums: Self::Sums, factors: *const f32);
    /// Stores `sum * factor`.
    ///
    /// # Safety
    /// `LANES` floats must be writable at `to`, and so many factors readable.
    unsafe fn store_floats(self, to: *mut f32, sums: Self::Sums, factors: *const f32);
}

/// A set of instructions that this processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dots {
    Portable,
    /// AVX2: `vpmaddwd` on bytes that are widened in registers. (`vpmaddubsw` would saturate.)
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// AVX-VNNI: `vpdpbusd` on vectors of 256 bits.
    #[cfg(target_arch = "x86_64")]
    AvxVnni,
    /// AVX-512 VNNI: `vpdpbusd` on vectors of 512 bits.
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni,
    /// The dot-product extension of 64-bit Arm: `sdot`.
    #[cfg(target_arch = "aarch64")]
    Sdot,
}

impl Dots {
    /// Those that this processor has.
    #[cfg(test)]
    pub fn available() -> Vec<Self> {
        let mut found = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            found.extend(x86::Madd::new().map(|_| Self::Avx2));
            found.extend(x86::Vnni256::new().map(|_| Self::AvxVnni));
            found.extend(x86::Vnni512::new().map(|_| Self::Avx512Vnni));
        }
        #[cfg(target_arch = "aarch64")]
        found.extend(aarch64::Sdot::new().map(|_| Self::Sdot));
        found
    }

    /// The fastest of an instruction set.
    pub fn of(isa: Isa) -> Self {
        match isa {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 if x86::Vnni512::new().is_some() => Self::Avx512Vnni,
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 | Isa::Avx2 if x86::Vnni256::new().is_some() => Self::AvxVnni,
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 | Isa::Avx2 if x86::Madd::new().is_some() => Self::Avx2,
            #[cfg(target_arch = "aarch64")]
            Isa::Neon if aarch64::Sdot::new().is_some() => Self::Sdot,
            _ => Self::Portable,
        }
    }

    /// Whether they multiply and add bytes as they are. The others widen them first, which takes longer than products of floats.
    pub fn is_native(self) -> bool {
        match self {
            Self::Portable => false,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => false,
            #[cfg(target_arch = "x86_64")]
            Self::AvxVnni | Self::Avx512Vnni => true,
            #[cfg(target_arch = "aarch64")]
            Self::Sdot => true,
        }
    }

    /// Runs a kernel, with the portable code if the processor does not have the instructions.
    pub fn run<K: DotKernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => {}
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                if let Some(dots) = x86::Madd::new() {
                    return dots.run(kernel);
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::AvxVnni => {
                if let Some(dots) = x86::Vnni256::new() {
                    return dots.run(kernel);
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512Vnni => {
                if let Some(dots) = x86::Vnni512::new() {
                    return dots.run(kernel);
                }
            }
            #[cfg(target_arch = "aarch64")]
            Self::Sdot => {
                if let Some(dots) = aarch64::Sdot::new() {
                    return dots.run(kernel);
                }
            }
        }
        Portable.run(kernel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest and smallest operands, ties, and saturation.
    struct Extremes;
    impl DotKernel for Extremes {
        type Output = ();
        #[inline(always)]
        fn run<D: ByteDots>(self, dots: D) {
            let n = D::LANES;
            let bytes = [255u8, 254, 3, 255];
            let weights: Vec<i8> = (0..4 * n)
                .map(|i| [127, -127, 99, 127, -127, -1, 5, -127][i % 8] - (i / 8) as i8)
                .collect();
            let start: Vec<i32> = (0..n as i32).map(|i| 1000 * i - 7).collect();
            let expected: Vec<i32> = (0..n)
                .map(|i| {
                    let lane = &weights[4 * i..][..4];
                    let products = lane
                        .iter()
                        .zip(bytes)
                        .map(|(&w, b)| i32::from(w) * i32::from(b));
                    start[i] + products.sum::<i32>()
                })
                .collect();
            let corrected: Vec<i32> = (0..n)
                .map(|i| {
                    let lane = &weights[4 * i..][..4];
                    start[i] - D::OFFSET * lane.iter().map(|&w| i32::from(w)).sum::<i32>()
                })
                .collect();
            let factors: Vec<f32> = (0..n).map(|i| [0.5, 0.004, 1e-3, 1.0][i % 4]).collect();
            let (mut to, mut floats) = (vec![9u8; n], vec![0.0f32; n]);
            // SAFETY: all hold a vector.
            unsafe {
                let sums = dots.dot(
                    dots.sums(corrected.as_ptr()),
                    dots.word(bytes.as_ptr()),
                    dots.weights(weights.as_ptr()),
                );
                dots.store_bytes(to.as_mut_ptr(), sums, factors.as_ptr());
                dots.store_floats(floats.as_mut_ptr(), sums, factors.as_ptr());
                for i in 0..n {
                    let value = expected[i].max(0) as f32 * factors[i];
                    assert_eq!(to[i], value.round_ties_even().min(255.0) as u8, "lane {i}");
                    assert_eq!(floats[i], expected[i] as f32 * factors[i], "lane {i}");
                }
                let ties: Vec<i32> = (0..n as i32).map(|i| 2 * i - 3).collect();
                let huge = vec![i32::MAX; n];
                let half = vec![0.5; n];
                for sums in [&ties, &huge] {
                    dots.store_bytes(to.as_mut_ptr(), dots.sums(sums.as_ptr()), half.as_ptr());
                    for (to, &sum) in to.iter().zip(sums) {
                        let value = sum.max(0) as f32 * 0.5;
                        assert_eq!(*to, value.round_ties_even().min(255.0) as u8);
                    }
                }
            }
        }
    }

    #[test]
    fn all_instructions_give_the_same_numbers() {
        for dots in Dots::available() {
            dots.run(Extremes);
        }
        for isa in Isa::available() {
            assert!(Dots::available().contains(&Dots::of(isa)), "{isa}");
        }
    }
}
