//! PCA whitening of VLAD vectors (paper, eq. 8).

use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt_stored};

use crate::describe::normalise;
use crate::parameter::{Parameter, Values};

/// `P (v - mean)` scaled to unit length, for each of the VLAD vectors `rows` (n x K*D). A row of zeros (no position of the
/// image is visible) stays zeros.
///
/// The projection is read in the data type in which it is stored: for one vector, reading it from memory is most of the
/// work.
pub(crate) fn whiten(isa: Isa, rows: &[f32], mean: &[f32], projection: &Parameter) -> Vec<f32> {
    let len = mean.len();
    let count = rows.len() / len;
    let mut centred = rows.to_vec();
    let is_seen: Vec<bool> = centred
        .chunks_exact_mut(len)
        .map(|row| {
            let seen = row.iter().any(|&v| v != 0.0);
            row.iter_mut().zip(mean).for_each(|(v, m)| *v -= m);
            seen
        })
        .collect();
    let axes = projection.values.len() / len;
    let mut out = vec![0.0; count * axes];
    let (left, product) = (
        MatRef::new(&centred, count, len),
        MatMut::new(&mut out, count, axes),
    );
    match &projection.values {
        Values::F32(values) => {
            matmul_nt_stored(isa, left, MatRef::new(values, axes, len), product);
        }
        Values::F16(values) => {
            matmul_nt_stored(isa, left, MatRef::new(values, axes, len), product);
        }
        Values::I8 { values, .. } => {
            matmul_nt_stored(isa, left, MatRef::new(values, axes, len), product);
        }
    }
    for (row, seen) in out.chunks_exact_mut(axes).zip(is_seen) {
        if !seen {
            row.fill(0.0);
        } else if let Values::I8 { scales, .. } = &projection.values {
            row.iter_mut()
                .zip(scales)
                .for_each(|(v, scale)| *v *= scale);
        }
        normalise(row);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter::DataType;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn parameter(values: Vec<f32>, columns: usize) -> Parameter {
        Parameter {
            shape: vec![values.len() / columns, columns],
            values: Values::F32(values),
        }
    }

    /// No multiple of a vector.
    const LEN: usize = 1125;

    #[test]
    fn every_data_type_and_instruction_set_gives_the_same_descriptor() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut uniform =
            |n: usize| -> Vec<f32> { (0..n).map(|_| random.random_range(-1.0..1.0)).collect() };
        let projection = parameter(uniform(8 * LEN), LEN);
        let mean = uniform(LEN);
        let mut rows = uniform(3 * LEN);
        rows[LEN..2 * LEN].fill(0.0);
        let exact = whiten(Isa::Portable, &rows, &mean, &projection);
        assert!(exact[8..16].iter().all(|&v| v == 0.0));
        for (data_type, tolerance) in [
            (DataType::F32, 1e-5),
            (DataType::F16, 1e-3),
            (DataType::I8, 2e-2),
        ] {
            let stored = projection.converted(data_type);
            // With the stored values in single precision only the rounding of the sums differs.
            let widened = parameter(stored.to_f32(), LEN);
            let same = whiten(Isa::Portable, &rows, &mean, &widened);
            for isa in Isa::available() {
                let found = whiten(isa, &rows, &mean, &stored);
                for ((found, same), exact) in found.iter().zip(&same).zip(&exact) {
                    let (a, b) = ((found - same).abs(), (found - exact).abs());
                    assert!(a < 1e-5 && b < tolerance, "{isa} {data_type:?}: {a} {b}");
                }
            }
        }
    }
}
