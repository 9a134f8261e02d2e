//! Products of `f32` matrices, row-major.

use rayon::prelude::*;

use crate::Isa;

fn check(m: usize, n: usize, k: usize, a: usize, b: usize, c: usize) {
    assert_eq!(
        (a, b, c),
        (m * k, n * k, m * n),
        "elements of a, b and c for m={m}, n={n}, k={k}"
    );
}

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten).
///
/// # Panics
/// If a slice has another length.
pub fn matmul_nt(_isa: Isa, m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    check(m, n, k, a.len(), b.len(), c.len());
    if m * n == 0 {
        return;
    }
    c.par_chunks_exact_mut(n).enumerate().for_each(|(i, row)| {
        for (j, out) in row.iter_mut().enumerate() {
            *out = a[i * k..][..k]
                .iter()
                .zip(&b[j * k..][..k])
                .map(|(x, y)| x * y)
                .sum();
        }
    });
}

/// `c = a b`: `a` is `m x k`, `b` is `k x n`, `c` is `m x n` (overwritten).
///
/// # Panics
/// If a slice has another length.
pub fn matmul_nn(_isa: Isa, m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    check(m, n, k, a.len(), b.len(), c.len());
    if m * n == 0 {
        return;
    }
    c.par_chunks_exact_mut(n).enumerate().for_each(|(i, row)| {
        row.fill(0.0);
        for (l, &value) in a[i * k..][..k].iter().enumerate() {
            for (out, y) in row.iter_mut().zip(&b[l * n..][..n]) {
                *out += value * y;
            }
        }
    });
}
