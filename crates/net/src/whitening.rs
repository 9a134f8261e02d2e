//! PCA whitening of VLAD vectors (paper, eq. 8).

use grimnet_kernels::{Isa, PlainKernel};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

use crate::Parameter;
use crate::describe::{dot, normalise};
use crate::model::Values;

/// Numbers of the projection that are widened to single precision at a time.
const BLOCK: usize = 1024;

/// P (v - mean), then unit length, of `rows` of VLAD vectors (n x K*D). A row of zeros (nothing seen) stays zeros.
///
/// The projection is read as it is stored, in half precision: for one vector, reading it is most of the work.
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
            .map(|axis| half_products(isa, &centred, axis))
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

fn half_products(isa: Isa, rows: &[Option<Vec<f32>>], axis: &[f16]) -> Vec<f32> {
    let mut sums = vec![0.0; rows.len()];
    let mut wide = [0.0; BLOCK];
    for (i, block) in axis.chunks(BLOCK).enumerate() {
        let wide = &mut wide[..block.len()];
        block.convert_to_f32_slice(wide);
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
