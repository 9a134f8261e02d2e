//! Four floats at a time in plain Rust, which the compiler turns into vectors of the target's baseline.

use super::backend::simd_backend;

const LANES: usize = 4;

/// 4 floats per vector, on every processor.
#[derive(Clone, Copy)]
pub(crate) struct Portable;

#[inline(always)]
fn zip(a: [f32; LANES], b: [f32; LANES], f: impl Fn(f32, f32) -> f32) -> [f32; LANES] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

simd_backend! {
    Portable, vector: [f32; LANES], lanes: LANES, mr: 6,
    splat: |value| [value; LANES],
    add: |a, b| zip(a, b, |a, b| a + b),
    sub: |a, b| zip(a, b, |a, b| a - b),
    mul: |a, b| zip(a, b, |a, b| a * b),
    // Not `f32::mul_add`, which is a library call if the baseline has no fused instruction.
    mul_add: |a, b, c| zip(zip(a, b, |a, b| a * b), c, |ab, c| ab + c),
    neg_mul_add: |a, b, c| zip(c, zip(a, b, |a, b| a * b), |c, ab| c - ab),
    max: |a, b| zip(a, b, |a, b| if a > b { a } else { b }),
    sum: |a| (a[0] + a[2]) + (a[1] + a[3]),
    // An array of floats has the alignment of a float.
    load: |from| from.cast::<[f32; LANES]>().read(),
    load_f16: |from| from.cast::<[half::f16; LANES]>().read().map(f32::from),
    load_i8: |from| from.cast::<[i8; LANES]>().read().map(f32::from),
    store: |to, value| to.cast::<[f32; LANES]>().write(value),
    transpose: transpose_4x4,
}

/// Transposes 4 x 4 floats.
///
/// # Safety
/// As [`Simd::transpose`](super::Simd::transpose).
#[inline(always)]
unsafe fn transpose_4x4(from: *const f32, from_stride: usize, to: *mut f32, to_stride: usize) {
    for i in 0..LANES {
        for j in 0..LANES {
            // SAFETY: the caller's contract.
            unsafe { *to.add(i * to_stride + j) = *from.add(j * from_stride + i) };
        }
    }
}
