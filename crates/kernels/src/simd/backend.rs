//! The macro that implements [`Simd`](super::Simd) from a list of intrinsics.

/// Implements [`Simd`](super::Simd) for a token type.
///
/// Each operation is given as `|arguments| expression`. The expressions may use intrinsics of `features`: a token exists
/// only if the processor has them. Without `features` the backend is plain Rust for the target's baseline.
macro_rules! simd_backend {
    (
        $token:ident, vector: $vector:ty, lanes: $lanes:expr, mr: $mr:expr,
        $(features: $features:literal,)?
        splat: |$value:ident| $splat:expr,
        add: |$add_a:ident, $add_b:ident| $add:expr,
        sub: |$sub_a:ident, $sub_b:ident| $sub:expr,
        mul: |$mul_a:ident, $mul_b:ident| $mul:expr,
        mul_add: |$fma_a:ident, $fma_b:ident, $fma_c:ident| $fma:expr,
        neg_mul_add: |$fnma_a:ident, $fnma_b:ident, $fnma_c:ident| $fnma:expr,
        max: |$max_a:ident, $max_b:ident| $max:expr,
        sum: |$sum_a:ident| $sum:expr,
        load: |$from:ident| $load:expr,
        load_f16: |$from_f16:ident| $load_f16:expr,
        load_i8: |$from_i8:ident| $load_i8:expr,
        store: |$to:ident, $stored:ident| $store:expr,
        transpose: $transpose:path,
    ) => {
        // SAFETY (of every block below): the token proves that the processor has the features; memory that is read or
        // written is covered by the contract of the trait's method. Plain Rust needs no `unsafe` for most operations.
        #[allow(unused_unsafe)]
        impl $crate::simd::Simd for $token {
            type V = $vector;
            const LANES: usize = $lanes;
            const MR: usize = $mr;

            #[inline(always)]
            fn run<K: $crate::simd::Kernel>(self, kernel: K) -> K::Output {
                $(#[target_feature(enable = $features)])?
                fn compiled<K: $crate::simd::Kernel>(simd: $token, kernel: K) -> K::Output {
                    kernel.run(simd)
                }
                // SAFETY: see above.
                unsafe { compiled(self, kernel) }
            }
            #[inline(always)]
            fn splat(self, $value: f32) -> Self::V {
                // SAFETY: see above.
                unsafe { $splat }
            }
            #[inline(always)]
            fn add(self, $add_a: Self::V, $add_b: Self::V) -> Self::V {
                // SAFETY: see above.
                unsafe { $add }
            }
            #[inline(always)]
            fn sub(self, $sub_a: Self::V, $sub_b: Self::V) -> Self::V {
                // SAFETY: see above.
                unsafe { $sub }
            }
            #[inline(always)]
            fn mul(self, $mul_a: Self::V, $mul_b: Self::V) -> Self::V {
                // SAFETY: see above.
                unsafe { $mul }
            }
            #[inline(always)]
            fn mul_add(self, $fma_a: Self::V, $fma_b: Self::V, $fma_c: Self::V) -> Self::V {
                // SAFETY: see above.
                unsafe { $fma }
            }
            #[inline(always)]
            fn neg_mul_add(self, $fnma_a: Self::V, $fnma_b: Self::V, $fnma_c: Self::V) -> Self::V {
                // SAFETY: see above.
                unsafe { $fnma }
            }
            #[inline(always)]
            fn max(self, $max_a: Self::V, $max_b: Self::V) -> Self::V {
                // SAFETY: see above.
                unsafe { $max }
            }
            #[inline(always)]
            fn sum(self, $sum_a: Self::V) -> f32 {
                // SAFETY: see above.
                unsafe { $sum }
            }
            #[inline(always)]
            unsafe fn load(self, $from: *const f32) -> Self::V {
                // SAFETY: see above.
                unsafe { $load }
            }
            #[inline(always)]
            unsafe fn load_f16(self, $from_f16: *const half::f16) -> Self::V {
                // SAFETY: see above.
                unsafe { $load_f16 }
            }
            #[inline(always)]
            unsafe fn load_i8(self, $from_i8: *const i8) -> Self::V {
                // SAFETY: see above.
                unsafe { $load_i8 }
            }
            #[inline(always)]
            unsafe fn store(self, $to: *mut f32, $stored: Self::V) {
                // SAFETY: see above.
                unsafe { $store }
            }
            #[inline(always)]
            unsafe fn transpose(
                self,
                from: *const f32,
                from_stride: usize,
                to: *mut f32,
                to_stride: usize,
            ) {
                // SAFETY: see above.
                unsafe { $transpose(from, from_stride, to, to_stride) }
            }
        }
    };
}

pub(super) use simd_backend;
