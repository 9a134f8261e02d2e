//! Projections of VLAD vectors to the global descriptor (paper, eq. 8), fitted to training pairs.
//!
//! There are fewer samples than dimensions (8,192, or 32,768 for `vgg16`), so the principal axes come from the samples' Gram
//! matrix and no covariance matrix of all dimensions is ever made.

use crate::TrainError;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par, Side};
use serde::{Deserialize, Serialize};

/// How the projection is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhiteningKind {
    /// Principal axes, each scaled to unit variance (Jegou and Chum 2012; the paper's).
    Pca,
    /// Principal axes, then whitened by the differences within pairs, then the axes that vary most between places (Mikolajczyk
    /// and Matas 2007; Radenovic et al. 2019): learns what changes between map and photo, and ignores it.
    Pairs,
}

/// A projection `P (v - mean)`.
#[derive(Clone, Debug)]
pub struct Projection {
    /// `[dim]`.
    pub mean: Vec<f32>,
    /// `[out, dim]`, row-major.
    pub rows: Vec<f32>,
}

/// Variance below this share of the mean one is raised to it: axes that the samples hardly show are not blown up.
const FLOOR_SHARE: f64 = 0.02;
/// Share of the mean variance added to the within-pair covariance.
const SHRINKAGE: f64 = 0.1;
/// Principal axes kept before the pairs' whitening, in units of the output's length.
const AXES_PER_OUTPUT: usize = 2;

fn product(left: MatRef<'_, f64>, right: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(left.nrows(), right.ncols());
    matmul(
        out.as_mut(),
        Accum::Replace,
        left,
        right,
        1.0,
        Par::rayon(0),
    );
    out
}

/// Eigenvalues and vectors of a symmetric matrix, largest first.
fn eigen(matrix: &Mat<f64>) -> Result<(Vec<f64>, Mat<f64>), TrainError> {
    let found = matrix
        .self_adjoint_eigen(Side::Lower)
        .map_err(|error| TrainError::Config {
            reason: format!("the whitening's covariance has no eigenvectors: {error:?}"),
        })?;
    let n = matrix.nrows();
    let values = (0..n).map(|i| found.S()[n - 1 - i]).collect();
    let vectors = Mat::from_fn(n, n, |i, j| found.U()[(i, n - 1 - j)]);
    Ok((values, vectors))
}

/// Fits a projection to `out` values.
///
/// `vectors` is `[2 * pairs, dim]`: the map views' vectors, then their photos' in the same order.
///
/// # Errors
/// [`TrainError::Config`] where there are fewer samples than `out` needs.
pub fn fit_whitening(
    vectors: &[f32],
    dim: usize,
    out: usize,
    kind: WhiteningKind,
) -> Result<Projection, TrainError> {
    let count = vectors.len() / dim;
    let axes = match kind {
        WhiteningKind::Pca => out,
        WhiteningKind::Pairs => (AXES_PER_OUTPUT * out).min(count / 2),
    };
    if count < axes + 1 || axes < out {
        return Err(TrainError::Config {
            reason: format!(
                "whitening to {out} values needs more than {} views, not {count}",
                2 * out
            ),
        });
    }
    let mut mean = vec![0.0f64; dim];
    for row in vectors.chunks_exact(dim) {
        mean.iter_mut()
            .zip(row)
            .for_each(|(m, v)| *m += f64::from(*v) / count as f64);
    }
    let centred = Mat::from_fn(count, dim, |i, j| f64::from(vectors[i * dim + j]) - mean[j]);
    let gram = product(centred.as_ref(), centred.transpose());
    let (values, turned) = eigen(&gram)?;
    // Principal axis k is centred^T u_k / sqrt(lambda_k).
    let kept = Mat::from_fn(count, axes, |i, k| {
        turned[(i, k)] / values[k].max(1e-12).sqrt()
    });
    let basis = product(centred.transpose(), kept.as_ref());
    let variance: Vec<f64> = values.iter().take(axes).map(|v| v / count as f64).collect();
    let mixing = match kind {
        WhiteningKind::Pca => {
            let floor = variance.iter().sum::<f64>() / axes as f64 * FLOOR_SHARE;
            Mat::from_fn(axes, axes, |i, j| {
                if i == j {
                    1.0 / variance[i].max(floor).sqrt()
                } else {
                    0.0
                }
            })
        }
        WhiteningKind::Pairs => pair_mixing(&product(centred.as_ref(), basis.as_ref()), out)?,
    };
    let rows = product(mixing.as_ref(), basis.transpose());
    // The length is divided out afterwards; half precision likes numbers that are not tiny.
    let square: f64 = (0..rows.nrows())
        .map(|i| (0..dim).map(|j| rows[(i, j)].powi(2)).sum::<f64>())
        .sum();
    let scale = 0.1 / (square / (rows.nrows() * dim) as f64).sqrt().max(1e-12);
    let flat = (0..rows.nrows()).flat_map(|i| (0..dim).map(move |j| (i, j)));
    Ok(Projection {
        mean: mean.iter().map(|m| *m as f32).collect(),
        rows: flat.map(|(i, j)| (rows[(i, j)] * scale) as f32).collect(),
    })
}

/// From principal coordinates `[2 * pairs, axes]` to `out` values: `[out, axes]`.
fn pair_mixing(coordinates: &Mat<f64>, out: usize) -> Result<Mat<f64>, TrainError> {
    let (count, axes) = (coordinates.nrows(), coordinates.ncols());
    let pairs = count / 2;
    let differences = Mat::from_fn(pairs, axes, |i, j| {
        (coordinates[(i, j)] - coordinates[(pairs + i, j)]) / (pairs as f64).sqrt()
    });
    let mut within = product(differences.transpose(), differences.as_ref());
    let shrink = (0..axes).map(|i| within[(i, i)]).sum::<f64>() / axes as f64 * SHRINKAGE;
    for i in 0..axes {
        within[(i, i)] += shrink;
    }
    let (values, vectors) = eigen(&within)?;
    let whitener = Mat::from_fn(axes, axes, |i, j| {
        vectors[(j, i)] / values[i].max(1e-12).sqrt()
    });
    let whitened = product(coordinates.as_ref(), whitener.transpose());
    let scatter = product(whitened.transpose(), whitened.as_ref());
    let (_, between) = eigen(&scatter)?;
    let first = Mat::from_fn(out, axes, |i, j| between[(j, i)]);
    Ok(product(first.as_ref(), whitener.as_ref()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// Places differ along 12 axes, views of a place along 6 others that are much longer.
    fn samples(pairs: usize, dim: usize) -> Vec<f32> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(9);
        let mut all = vec![0.0f32; 2 * pairs * dim];
        for p in 0..pairs {
            let place: Vec<f32> = (0..12).map(|_| random.random_range(-1.0..1.0)).collect();
            for view in 0..2 {
                let row = &mut all[(view * pairs + p) * dim..][..dim];
                row[..12].copy_from_slice(&place);
                for v in &mut row[12..18] {
                    *v = random.random_range(-4.0..4.0);
                }
                for v in &mut row[18..] {
                    *v = random.random_range(-0.05..0.05);
                }
            }
        }
        all
    }

    fn recall(projection: &Projection, vectors: &[f32], dim: usize) -> f64 {
        let project = |row: &[f32]| {
            let mut out: Vec<f32> = projection
                .rows
                .chunks_exact(dim)
                .map(|p| {
                    p.iter()
                        .zip(row)
                        .zip(&projection.mean)
                        .map(|((p, v), m)| p * (v - m))
                        .sum()
                })
                .collect();
            let length = out.iter().map(|v| v * v).sum::<f32>().sqrt();
            out.iter_mut().for_each(|v| *v /= length);
            out
        };
        let all: Vec<Vec<f32>> = vectors.chunks_exact(dim).map(project).collect();
        let pairs = all.len() / 2;
        let right = (0..pairs).filter(|i| {
            let similarity = |j: usize| {
                all[pairs + i]
                    .iter()
                    .zip(&all[j])
                    .map(|(a, b)| a * b)
                    .sum::<f32>()
            };
            (0..pairs).all(|j| j == *i || similarity(j) < similarity(*i))
        });
        right.count() as f64 / pairs as f64
    }

    #[test]
    fn pairs_ignore_what_changes_between_views_and_pca_equalises_variance() {
        let dim = 40;
        let vectors = samples(120, dim);
        let pca = fit_whitening(&vectors, dim, 12, WhiteningKind::Pca).unwrap();
        let pairs = fit_whitening(&vectors, dim, 12, WhiteningKind::Pairs).unwrap();
        let (a, b) = (recall(&pca, &vectors, dim), recall(&pairs, &vectors, dim));
        assert!(b > 0.9 && b > a, "pairs {b}, PCA {a}");
        let variance = |axis: usize| {
            let row = &pca.rows[axis * dim..(axis + 1) * dim];
            vectors
                .chunks_exact(dim)
                .map(|v| {
                    v.iter()
                        .zip(row)
                        .zip(&pca.mean)
                        .map(|((v, r), m)| f64::from((v - m) * r))
                        .sum::<f64>()
                        .powi(2)
                })
                .sum::<f64>()
        };
        assert!((variance(0) / variance(11) - 1.0).abs() < 0.01);
        assert!(fit_whitening(&vectors[..dim * 10], dim, 12, WhiteningKind::Pca).is_err());
    }
}
