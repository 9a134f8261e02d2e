//! PCA whitening of VLAD vectors (paper, eq. 8).

use rayon::prelude::*;

use crate::Model;
use crate::describe::{dot, normalise};

/// P (v - mean), then unit length.
pub(crate) struct Whitening {
    mean: Vec<f32>,
    /// Rows of P.
    projection: Vec<f32>,
}

impl Whitening {
    /// Of a model that has it.
    pub(crate) fn of(model: &Model) -> Self {
        let values = |name: &str| {
            model
                .parameter(name)
                .map(|parameter| parameter.to_f32())
                .unwrap_or_default()
        };
        Self {
            mean: values("whitening.mean"),
            projection: values("whitening.projection"),
        }
    }

    /// `rows` of VLAD vectors (n x K*D) to rows of global descriptors. A row of zeros (nothing seen) stays zeros.
    pub(crate) fn apply(&self, rows: &[f32]) -> Vec<f32> {
        let len = self.mean.len();
        let centred: Vec<Option<Vec<f32>>> = rows
            .chunks_exact(len)
            .map(|row| {
                row.iter()
                    .any(|&v| v != 0.0)
                    .then(|| row.iter().zip(&self.mean).map(|(v, m)| v - m).collect())
            })
            .collect();
        // One pass over the projection, which is far larger than the vectors.
        let columns: Vec<Vec<f32>> = self
            .projection
            .par_chunks_exact(len)
            .map(|axis| {
                centred
                    .iter()
                    .map(|row| row.as_ref().map_or(0.0, |row| dot(axis, row)))
                    .collect()
            })
            .collect();
        let mut out = Vec::with_capacity(centred.len() * columns.len());
        for row in 0..centred.len() {
            let start = out.len();
            out.extend(columns.iter().map(|column| column[row]));
            normalise(&mut out[start..]);
        }
        out
    }
}
