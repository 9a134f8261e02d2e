//! Whitening: projections of VLAD vectors to the global descriptor (paper, eq. 8), fitted to training pairs.
//!
//! VLAD vectors have 8,192 values (32,768 for the paper's network), too many for a full covariance matrix: the principal axes
//! are computed from a random sketch of the samples.

use crate::error::TrainError;
use faer::linalg::matmul::matmul;
use faer::traits::ComplexField;
use faer::{Accum, Mat, MatRef, Par, Side};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// The method of fitting the projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhiteningKind {
    /// Principal axes, each scaled to unit variance (Jegou and Chum 2012; the paper's method).
    Pca,
    /// Principal axes, then whitening by the differences within pairs, then the axes with the largest variance between places
    /// (Mikolajczyk and Matas 2007; Radenovic et al. 2019): suppresses what differs between map and photo.
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

/// Variances below this share of the mean variance are raised to it, so that noise is not amplified.
const FLOOR_SHARE: f64 = 0.02;
/// Share of the mean variance that is added to the diagonal of the within-pair covariance.
const SHRINKAGE: f64 = 0.1;
/// Principal axes before the whitening by pairs, as a multiple of the number of outputs.
const AXES_PER_OUTPUT: usize = 2;
/// Directions of the sketch in addition to the principal axes.
const OVERSAMPLING: usize = 64;
/// Power iterations of the sketch.
const POWER_ITERATIONS: usize = 2;

fn product<T: ComplexField>(left: MatRef<'_, T>, right: MatRef<'_, T>) -> Mat<T> {
    let mut out = Mat::zeros(left.nrows(), right.ncols());
    matmul(
        out.as_mut(),
        Accum::Replace,
        left,
        right,
        T::one_impl(),
        Par::rayon(0),
    );
    out
}

/// Eigenvalues and vectors of a symmetric matrix, largest first.
fn eigen(matrix: &Mat<f64>) -> Result<(Vec<f64>, Mat<f64>), TrainError> {
    let found = matrix
        .self_adjoint_eigen(Side::Lower)
        .map_err(|error| TrainError::Config {
            reason: format!(
                "cannot compute the eigenvectors of the covariance for whitening: {error:?}"
            ),
        })?;
    let n = matrix.nrows();
    let values = (0..n).map(|i| found.S()[n - 1 - i]).collect();
    let vectors = Mat::from_fn(n, n, |i, j| found.U()[(i, n - 1 - j)]);
    Ok((values, vectors))
}

/// An orthonormal basis of the columns.
fn orthonormal(columns: &Mat<f32>) -> Mat<f32> {
    columns.qr().compute_thin_Q()
}

/// Principal axes of the VLAD vectors of training pairs, for either kind of whitening.
#[derive(Debug)]
pub struct PrincipalAxes {
    mean: Vec<f32>,
    /// `[dim, axes]`, orthonormal.
    basis: Mat<f32>,
    /// Variance along each axis, largest first.
    variance: Vec<f64>,
    /// `[2 * pairs, axes]`: the samples along the axes.
    coordinates: Mat<f64>,
}

impl PrincipalAxes {
    /// The axes for whitening to `out` values, by randomised subspace iteration (Halko, Martinsson and Tropp 2011, algorithms
    /// 4.4 and 5.1).
    ///
    /// # Shapes
    /// `vectors` `[2 * pairs, dim]`: the vectors of the map views, then those of their photos in the same order.
    ///
    /// # Errors
    /// [`TrainError::Config`] if there are not more pairs than `out`.
    pub fn of(mut vectors: Vec<f32>, dim: usize, out: usize) -> Result<Self, TrainError> {
        let count = vectors.len() / dim;
        if count / 2 < out + 1 {
            return Err(TrainError::Config {
                reason: format!(
                    "whitening to {out} values needs more than {out} pairs, but there are {}; raise `export.whitening_pairs`, \
                     or set it to 0 for a model without whitening",
                    count / 2
                ),
            });
        }
        let mut sum = vec![0.0f64; dim];
        for row in vectors.chunks_exact(dim) {
            sum.iter_mut()
                .zip(row)
                .for_each(|(s, v)| *s += f64::from(*v));
        }
        let mean: Vec<f32> = sum.iter().map(|s| (s / count as f64) as f32).collect();
        for row in vectors.chunks_exact_mut(dim) {
            row.iter_mut().zip(&mean).for_each(|(v, m)| *v -= m);
        }
        let samples = MatRef::from_row_major_slice(&vectors, count, dim);
        let axes = (AXES_PER_OUTPUT * out).min(count / 2).min(dim);
        let width = (axes + OVERSAMPLING).min(count).min(dim);
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let directions = Mat::from_fn(dim, width, |_, _| random.random_range(-1.0f32..1.0));
        let mut seen = product(samples, directions.as_ref());
        for _ in 0..POWER_ITERATIONS {
            let back = product(samples.transpose(), orthonormal(&seen).as_ref());
            seen = product(samples, orthonormal(&back).as_ref());
        }
        let sketch = product(samples.transpose(), orthonormal(&seen).as_ref());
        let gram = product(sketch.transpose(), sketch.as_ref());
        let gram = Mat::from_fn(width, width, |i, j| f64::from(gram[(i, j)]));
        let (values, turned) = eigen(&gram)?;
        let kept = Mat::from_fn(width, axes, |i, k| {
            (turned[(i, k)] / values[k].max(1e-12).sqrt()) as f32
        });
        let basis = product(sketch.as_ref(), kept.as_ref());
        let along = product(samples, basis.as_ref());
        Ok(Self {
            mean,
            basis,
            variance: values.iter().take(axes).map(|v| v / count as f64).collect(),
            coordinates: Mat::from_fn(count, axes, |i, k| f64::from(along[(i, k)])),
        })
    }

    /// The projection to `out` values, at most as many as the axes were computed for.
    ///
    /// # Errors
    /// [`TrainError::Config`] if the eigenvectors cannot be computed.
    pub fn whitening(&self, out: usize, kind: WhiteningKind) -> Result<Projection, TrainError> {
        let axes = self.variance.len();
        let mixing = match kind {
            WhiteningKind::Pca => {
                let variance = &self.variance[..out];
                let floor = variance.iter().sum::<f64>() / out as f64 * FLOOR_SHARE;
                Mat::from_fn(out, axes, |i, j| {
                    if i == j {
                        1.0 / variance[i].max(floor).sqrt()
                    } else {
                        0.0
                    }
                })
            }
            WhiteningKind::Pairs => pair_mixing(&self.coordinates, out)?,
        };
        let mixing = Mat::from_fn(out, axes, |i, j| mixing[(i, j)] as f32);
        let rows = product(mixing.as_ref(), self.basis.transpose());
        let dim = rows.ncols();
        // Descriptors are normalised afterwards, so the scale is free: this one suits half precision.
        let square: f64 = (0..out)
            .map(|i| {
                (0..dim)
                    .map(|j| f64::from(rows[(i, j)]).powi(2))
                    .sum::<f64>()
            })
            .sum();
        let scale = 0.1 / (square / (out * dim) as f64).sqrt().max(1e-12);
        let flat = (0..out).flat_map(|i| (0..dim).map(move |j| (i, j)));
        Ok(Projection {
            mean: self.mean.clone(),
            rows: flat.map(|(i, j)| rows[(i, j)] * scale as f32).collect(),
        })
    }
}

/// The projection `[out, axes]` of coordinates `[2 * pairs, axes]`, by the whitening of pairs.
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

    /// Places differ along 12 axes, views of a place along 6 others that are much longer.
    fn samples(pairs: usize, dim: usize) -> Vec<f32> {
        let mut random = ChaCha8Rng::seed_from_u64(9);
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
            grimnet_net::normalise(&mut out);
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
        let axes = PrincipalAxes::of(vectors.clone(), dim, 12).unwrap();
        let pca = axes.whitening(12, WhiteningKind::Pca).unwrap();
        let pairs = axes.whitening(12, WhiteningKind::Pairs).unwrap();
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
        assert!(PrincipalAxes::of(vectors[..dim * 20].to_vec(), dim, 12).is_err());
    }

    #[test]
    fn the_sketch_finds_the_axes_of_the_covariance() {
        let (pairs, dim, out) = (200, 300, 10);
        let mut random = ChaCha8Rng::seed_from_u64(4);
        // Variances fall slowly, as those of VLAD vectors do, and no axis is one of the coordinates.
        let turn = orthonormal(&Mat::from_fn(dim, dim, |_, _| {
            random.random_range(-1.0f32..1.0)
        }));
        let drawn = Mat::from_fn(2 * pairs, dim, |_, j| {
            random.random_range(-1.0f32..1.0) * 3.0 / (j as f32 + 3.0)
        });
        let samples = product(drawn.as_ref(), turn.transpose());
        let rows = (0..2 * pairs).flat_map(|i| (0..dim).map(move |j| (i, j)));
        let flat: Vec<f32> = rows.map(|at| samples[at]).collect();
        let found = PrincipalAxes::of(flat, dim, out).unwrap();
        assert_eq!(found.basis.ncols(), AXES_PER_OUTPUT * out);

        let mean: Vec<f64> = (0..dim)
            .map(|j| {
                (0..2 * pairs)
                    .map(|i| f64::from(samples[(i, j)]))
                    .sum::<f64>()
                    / (2 * pairs) as f64
            })
            .collect();
        let centred = Mat::from_fn(2 * pairs, dim, |i, j| f64::from(samples[(i, j)]) - mean[j]);
        let covariance = product(centred.transpose(), centred.as_ref());
        let (values, vectors) = eigen(&covariance).unwrap();
        for (k, (estimate, sum)) in found.variance.iter().zip(&values).enumerate() {
            let exact = sum / (2 * pairs) as f64;
            assert!((estimate / exact - 1.0).abs() < 0.01, "axis {k}");
        }
        for k in 0..out {
            let cosine: f64 = (0..dim)
                .map(|i| f64::from(found.basis[(i, k)]) * vectors[(i, k)])
                .sum();
            assert!(cosine.abs() > 0.98, "axis {k}: {cosine}");
        }
    }
}
