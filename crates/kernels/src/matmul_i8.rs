//! Products of 8-bit integer matrices: exact, in 32 bits.

use rayon::prelude::*;

use crate::Isa;

/// `c = a b^T`: `a` is `m x k`, `b` is `n x k`, `c` is `m x n` (overwritten). Exact while `k <= 131,000`.
///
/// # Panics
/// If a slice has another length.
pub fn matmul_nt_i8(_isa: Isa, m: usize, n: usize, k: usize, a: &[i8], b: &[i8], c: &mut [i32]) {
    assert_eq!(
        (a.len(), b.len(), c.len()),
        (m * k, n * k, m * n),
        "elements of a, b and c for m={m}, n={n}, k={k}"
    );
    if m * n == 0 {
        return;
    }
    c.par_chunks_exact_mut(n).enumerate().for_each(|(i, row)| {
        for (j, out) in row.iter_mut().enumerate() {
            let pairs = a[i * k..][..k].iter().zip(&b[j * k..][..k]);
            *out = pairs.map(|(&x, &y)| i32::from(x) * i32::from(y)).sum();
        }
    });
}
