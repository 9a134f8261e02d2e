//! One vector interface for all instruction sets, so that each kernel is written once.
//!
//! A kernel is a struct that implements [`Kernel`]; [`Isa::run`](crate::Isa) compiles its `run` once for each
//! instruction set, inside a function with the matching `#[target_feature]`. Every function called from `run` must be
//! `#[inline(always)]`, or be another kernel started through [`Simd::run`]; otherwise it is compiled without the features.
//!
//! A backend is a token type and one call of `simd_backend!`, which lists the intrinsics.

mod backend;

#[cfg(target_arch = "aarch64")]
mod aarch64;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use portable::Portable;

use crate::Isa;

/// Code to be compiled for an instruction set.
pub(crate) trait Kernel {
    type Output;
    /// Must be `#[inline(always)]`.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// The vector operations of an instruction set. A value of an implementing type exists only if the processor supports
/// the instruction set.
pub(crate) trait Simd: Copy + Send + Sync {
    /// A vector of `LANES` floats.
    type V: Copy;
    /// Floats in a vector: 4, 8 or 16.
    const LANES: usize;
    /// Rows of the largest micro-tile of a matrix product (mr): `MR` rows of two vectors are kept in registers as
    /// accumulators.
    const MR: usize;

    /// Runs a kernel compiled for this instruction set.
    fn run<K: Kernel>(self, kernel: K) -> K::Output;

    /// All lanes 0.
    #[inline(always)]
    fn zero(self) -> Self::V {
        self.splat(0.0)
    }
    /// All lanes `value`.
    fn splat(self, value: f32) -> Self::V;
    fn add(self, a: Self::V, b: Self::V) -> Self::V;
    fn sub(self, a: Self::V, b: Self::V) -> Self::V;
    fn mul(self, a: Self::V, b: Self::V) -> Self::V;
    /// `a * b + c`
    fn mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// `c - a * b`
    fn neg_mul_add(self, a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// The larger of `a` and `b`. NaN if `b` is NaN; `b` or NaN, depending on the instruction set, if only `a` is.
    fn max(self, a: Self::V, b: Self::V) -> Self::V;
    /// The sum of the lanes.
    fn sum(self, a: Self::V) -> f32;

    /// # Safety
    /// `LANES` floats must be readable at `from`.
    unsafe fn load(self, from: *const f32) -> Self::V;
    /// Half-precision numbers, widened.
    ///
    /// # Safety
    /// `LANES` numbers must be readable at `from`.
    unsafe fn load_f16(self, from: *const half::f16) -> Self::V;
    /// Signed bytes, widened.
    ///
    /// # Safety
    /// `LANES` bytes must be readable at `from`.
    unsafe fn load_i8(self, from: *const i8) -> Self::V;
    /// # Safety
    /// `LANES` floats must be writable at `to`.
    unsafe fn store(self, to: *mut f32, value: Self::V);

    /// Transposes a square of `LANES x LANES` floats: `to[i * to_stride + j] = from[j * from_stride + i]`.
    ///
    /// # Safety
    /// `LANES` floats must be readable at each `from + j * from_stride` and writable at each `to + i * to_stride`;
    /// the two squares must not overlap.
    unsafe fn transpose(self, from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize);
}

/// Code without intrinsics whose loops the compiler can vectorise by itself. [`Isa::vectorise`] compiles it for each
/// instruction set.
///
/// The compiler does not fuse multiplications and additions, so the results are identical on all instruction sets.
pub trait PlainKernel {
    /// The result.
    type Output;
    /// Runs the code. Mark this function, and all functions that it calls, `#[inline(always)]`; otherwise they are compiled
    /// for the baseline instruction set.
    fn run(self) -> Self::Output;
}

struct Plain<K>(K);

impl<K: PlainKernel> Kernel for Plain<K> {
    type Output = K::Output;
    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> K::Output {
        self.0.run()
    }
}

impl Isa {
    /// Runs code compiled for this instruction set, or for [`Isa::Portable`] if the processor does not support it.
    pub fn vectorise<K: PlainKernel>(self, kernel: K) -> K::Output {
        self.run(Plain(kernel))
    }

    /// Runs a kernel compiled for this instruction set, or for [`Isa::Portable`] if the processor does not support it.
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => match x86::Avx512::new() {
                Some(simd) => simd.run(kernel),
                None => Portable.run(kernel),
            },
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => match x86::Avx2::new() {
                Some(simd) => simd.run(kernel),
                None => Portable.run(kernel),
            },
            #[cfg(target_arch = "aarch64")]
            Isa::Neon => aarch64::Neon::new().run(kernel),
            _ => Portable.run(kernel),
        }
    }

    /// Floats in a vector of the kernels that [`Isa::run`] runs.
    pub(crate) fn lanes(self) -> usize {
        struct Lanes;
        impl Kernel for Lanes {
            type Output = usize;
            #[inline(always)]
            fn run<S: Simd>(self, _: S) -> usize {
                S::LANES
            }
        }
        self.run(Lanes)
    }

    /// This instruction set, or the portable one if `stride` floats are not a whole number of vectors.
    pub(crate) fn for_stride(self, stride: usize) -> Isa {
        if stride.is_multiple_of(self.lanes()) {
            self
        } else {
            Isa::Portable
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Everything;
    impl Kernel for Everything {
        type Output = ();
        #[inline(always)]
        fn run<S: Simd>(self, simd: S) {
            let n = S::LANES;
            let a: Vec<f32> = (0..n * n).map(|i| i as f32 + 0.5).collect();
            let b: Vec<f32> = (0..n).map(|i| 7.0 - 3.0 * i as f32).collect();
            let mut out = vec![0.0; n * n];
            // SAFETY: all three hold at least a vector, `a` and `out` a square.
            unsafe {
                let (va, vb, vc) = (
                    simd.load(a.as_ptr()),
                    simd.load(b.as_ptr()),
                    simd.splat(2.0),
                );
                for (v, f) in [
                    (simd.add(va, vb), (|a, b| a + b) as fn(f32, f32) -> f32),
                    (simd.sub(va, vb), |a, b| a - b),
                    (simd.mul(va, vb), |a, b| a * b),
                    (simd.max(va, vb), f32::max),
                    (simd.mul_add(va, vb, vc), |a, b| a * b + 2.0),
                    (simd.neg_mul_add(va, vb, vc), |a, b| 2.0 - a * b),
                    (simd.zero(), |_, _| 0.0),
                ] {
                    simd.store(out.as_mut_ptr(), v);
                    for i in 0..n {
                        assert_eq!(out[i], f(a[i], b[i]));
                    }
                }
                assert_eq!(simd.sum(va), a[..n].iter().sum());
                let bytes: Vec<i8> = (0..n).map(|i| (17 * i as i32 - 128) as i8).collect();
                simd.store(out.as_mut_ptr(), simd.load_i8(bytes.as_ptr()));
                assert!(out.iter().zip(&bytes).all(|(&v, &b)| v == f32::from(b)));
                let halves: Vec<half::f16> = b.iter().map(|&v| half::f16::from_f32(v)).collect();
                simd.store(out.as_mut_ptr(), simd.load_f16(halves.as_ptr()));
                assert_eq!(out[..n], b);
                simd.transpose(a.as_ptr(), n, out.as_mut_ptr(), n);
            }
            for i in 0..n * n {
                assert_eq!(out[i], a[i % n * n + i / n]);
            }
        }
    }

    #[test]
    fn vector_operations_equal_scalar_ones() {
        for isa in Isa::available() {
            isa.run(Everything);
        }
    }
}
