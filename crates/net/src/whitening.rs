//! PCA whitening of VLAD vectors (paper, eq. 8).

use grimnet_kernels::{Isa, PlainKernel};
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use crate::describe::{dot, normalise};
use crate::parameter::{Parameter, Values};

/// Values of the projection that are converted to single precision at a time: 4 kB, well inside the L1 cache.
const BLOCK: usize = 1024;

/// `P (v - mean)` scaled to unit length, for each of the VLAD vectors `rows` (n x K*D). A row of zeros (no position of the
/// image is visible) stays zeros.
///
/// The projection is read in the precision in which it is stored: for one vector, reading it from memory is most of the
/// work.
pub(crate) fn whiten(isa: Isa, rows: &[f32], mean: &[f32], projection: &Parameter) -> Vec<f32> {
    let len = mean.len();
    let centred: Vec<Option<Vec<f32>>> = rows
        .chunks_exact(len)
        .map(|row| {
            row.iter()
                .any(|&v| v != 0.0)
                .then(|| row.iter().zip(mean).map(|(v, m)| v - m).collect())
        })
        .collect();
    // One pass over the projection, which is far larger than the vectors.
    let columns: Vec<Vec<f32>> = match &projection.values {
        Values::F32(axes) => axes
            .par_chunks_exact(len)
            .map(|axis| products(&centred, |row| isa.vectorise(Dot(axis, row))))
            .collect(),
        Values::F16(axes) => axes
            .par_chunks_exact(len)
            .map(|axis| {
                widened_products(isa, &centred, axis, |from, to| {
                    from.convert_to_f32_slice(to);
                })
            })
            .collect(),
        Values::I8 { values, scales } => values
            .par_chunks_exact(len)
            .zip(scales)
            .map(|(axis, &scale)| {
                let mut sums = widened_products(isa, &centred, axis, |from, to| {
                    isa.vectorise(Widen(from, to));
                });
                sums.iter_mut().for_each(|sum| *sum *= scale);
                sums
            })
            .collect(),
    };
    let mut out = Vec::with_capacity(centred.len() * columns.len());
    for row in 0..centred.len() {
        let start = out.len();
        out.extend(columns.iter().map(|column| column[row]));
        normalise(&mut out[start..]);
    }
    out
}

fn products(rows: &[Option<Vec<f32>>], product: impl Fn(&[f32]) -> f32) -> Vec<f32> {
    rows.iter()
        .map(|row| row.as_deref().map_or(0.0, &product))
        .collect()
}

/// Scalar products of one axis of the projection with each row; `widen` converts a block of it to single precision.
fn widened_products<T>(
    isa: Isa,
    rows: &[Option<Vec<f32>>],
    axis: &[T],
    widen: impl Fn(&[T], &mut [f32]),
) -> Vec<f32> {
    let mut sums = vec![0.0; rows.len()];
    let mut wide = [0.0; BLOCK];
    for (i, block) in axis.chunks(BLOCK).enumerate() {
        let wide = &mut wide[..block.len()];
        widen(block, wide);
        for (sum, row) in sums.iter_mut().zip(rows) {
            if let Some(row) = row {
                *sum += isa.vectorise(Dot(wide, &row[i * BLOCK..][..wide.len()]));
            }
        }
    }
    sums
}

struct Dot<'a>(&'a [f32], &'a [f32]);

impl PlainKernel for Dot<'_> {
    type Output = f32;

    #[inline(always)]
    fn run(self) -> f32 {
        dot(self.0, self.1)
    }
}

struct Widen<'a>(&'a [i8], &'a mut [f32]);

impl PlainKernel for Widen<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(from, to) = self;
        to.iter_mut()
            .zip(from)
            .for_each(|(to, &from)| *to = f32::from(from));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameter::Precision;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn parameter(values: Vec<f32>, columns: usize) -> Parameter {
        Parameter {
            shape: vec![values.len() / columns, columns],
            values: Values::F32(values),
        }
    }

    /// Longer than a block, and no multiple of it.
    const LEN: usize = BLOCK + 100;

    #[test]
    fn every_precision_and_instruction_set_gives_the_same_descriptor() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut uniform =
            |n: usize| -> Vec<f32> { (0..n).map(|_| random.random_range(-1.0..1.0)).collect() };
        let projection = parameter(uniform(8 * LEN), LEN);
        let mean = uniform(LEN);
        let mut rows = uniform(3 * LEN);
        rows[LEN..2 * LEN].fill(0.0);
        let exact = whiten(Isa::Portable, &rows, &mean, &projection);
        assert!(exact[8..16].iter().all(|&v| v == 0.0));
        for (precision, tolerance) in [
            (Precision::F32, 1e-5),
            (Precision::F16, 1e-3),
            (Precision::I8, 2e-2),
        ] {
            let stored = projection.converted(precision);
            // With the stored values in single precision only the rounding of the sums differs.
            let widened = parameter(stored.to_f32(), LEN);
            let same = whiten(Isa::Portable, &rows, &mean, &widened);
            for isa in Isa::available() {
                let found = whiten(isa, &rows, &mean, &stored);
                for ((found, same), exact) in found.iter().zip(&same).zip(&exact) {
                    let (a, b) = ((found - same).abs(), (found - exact).abs());
                    assert!(a < 1e-5 && b < tolerance, "{isa} {precision:?}: {a} {b}");
                }
            }
        }
    }
}
