//! k-means clustering (Lloyd 1982) of descriptors, seeded; the result does not depend on the number of threads.

use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt};
use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Points compared with the centroids at once.
const POINTS_PER_TASK: usize = 1024;

/// Relative size of the step that splits a centroid in two (faiss: `Clustering.cpp`, EPS = 1/1024).
const SPLIT: f32 = 1.0 / 1024.0;

/// Settings of a k-means run.
#[derive(Clone, Copy, Debug)]
pub struct KMeans {
    /// Number of clusters.
    pub clusters: usize,
    /// Number of iterations; each assigns every point and moves every centroid.
    pub iterations: usize,
    /// Spherical k-means (Dhillon and Modha 2001): points are assigned by inner product, centroids have unit length.
    pub spherical: bool,
    /// Seed of the choice of the first centroids.
    pub seed: u64,
}

impl KMeans {
    /// Centroids of points, row by row. A cluster that loses all its points takes half of the largest one.
    ///
    /// # Shapes
    /// `points` `[n, dim]`, result `[min(clusters, n), dim]`.
    ///
    /// # Panics
    /// If `dim` is 0, `points` are no rows of `dim` numbers, or there are points and no cluster.
    pub fn run(&self, points: &[f32], dim: usize) -> Vec<f32> {
        let n = points.len() / dim;
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut first = index::sample(&mut rng, n, self.clusters.min(n)).into_vec();
        first.sort_unstable();
        let mut centroids: Vec<f32> = first
            .iter()
            .flat_map(|&i| points[i * dim..(i + 1) * dim].iter().copied())
            .collect();
        for _ in 0..self.iterations {
            let nearest = if self.spherical {
                nearest_by_product(&centroids, points, dim)
            } else {
                nearest_by_distance(&centroids, points, dim)
            };
            self.update(&mut centroids, points, dim, &nearest);
        }
        centroids
    }

    fn update(&self, centroids: &mut [f32], points: &[f32], dim: usize, nearest: &[u32]) {
        let clusters = centroids.len() / dim;
        // Members of each cluster in order of index: the sums do not depend on threads.
        let mut members = vec![Vec::new(); clusters];
        for (i, &c) in nearest.iter().enumerate() {
            members[c as usize].push(i);
        }
        centroids
            .par_chunks_exact_mut(dim)
            .zip(&members)
            .for_each(|(centroid, members)| {
                if members.is_empty() {
                    return;
                }
                let mut sum = vec![0.0f64; dim];
                for &i in members {
                    let point = &points[i * dim..(i + 1) * dim];
                    sum.iter_mut()
                        .zip(point)
                        .for_each(|(s, &x)| *s += f64::from(x));
                }
                let length = if self.spherical {
                    sum.iter()
                        .map(|s| s * s)
                        .sum::<f64>()
                        .sqrt()
                        .max(f64::MIN_POSITIVE)
                } else {
                    members.len() as f64
                };
                centroid
                    .iter_mut()
                    .zip(&sum)
                    .for_each(|(c, s)| *c = (s / length) as f32);
            });
        let mut sizes: Vec<usize> = members.iter().map(Vec::len).collect();
        for empty in 0..clusters {
            if sizes[empty] > 0 {
                continue;
            }
            let Some(largest) = (0..clusters).max_by_key(|&c| (sizes[c], std::cmp::Reverse(c)))
            else {
                return;
            };
            for d in 0..dim {
                let value = centroids[largest * dim + d];
                let step = if d % 2 == 0 { SPLIT } else { -SPLIT };
                centroids[empty * dim + d] = value * (1.0 + step);
                centroids[largest * dim + d] = value * (1.0 - step);
            }
            sizes[empty] = sizes[largest] / 2;
            sizes[largest] -= sizes[empty];
        }
    }
}

/// Index of the centroid with the largest inner product with each point; the first one if several are equal.
///
/// # Shapes
/// `centroids` `[clusters, dim]`, `points` `[n, dim]`, result `[n]`.
///
/// # Panics
/// If `dim` is 0, one of the two is no rows of `dim` numbers, or there are points and no centroid.
pub fn nearest_by_product(centroids: &[f32], points: &[f32], dim: usize) -> Vec<u32> {
    nearest(centroids, points, dim, |_| 0.0)
}

/// Index of the centroid with the smallest Euclidean distance to each point; the first one if several are equal.
///
/// # Shapes
/// As [`nearest_by_product`].
///
/// # Panics
/// As [`nearest_by_product`].
pub fn nearest_by_distance(centroids: &[f32], points: &[f32], dim: usize) -> Vec<u32> {
    // |x - c|^2 = |x|^2 - 2 (x c - |c|^2 / 2)
    nearest(centroids, points, dim, |c| {
        0.5 * c.iter().map(|v| v * v).sum::<f32>()
    })
}

fn nearest(
    centroids: &[f32],
    points: &[f32],
    dim: usize,
    offset: impl Fn(&[f32]) -> f32,
) -> Vec<u32> {
    let clusters = centroids.len() / dim;
    let offsets: Vec<f32> = centroids.chunks_exact(dim).map(offset).collect();
    let isa = Isa::detect();
    points
        .par_chunks(POINTS_PER_TASK * dim)
        .flat_map_iter(|points| {
            let count = points.len() / dim;
            let mut products = vec![0.0f32; count * clusters];
            matmul_nt(
                isa,
                MatRef::new(points, count, dim),
                MatRef::new(centroids, clusters, dim),
                MatMut::new(&mut products, count, clusters),
            );
            let best = |row: &[f32]| {
                let mut best = (f32::NEG_INFINITY, 0u32);
                for (c, (&product, &offset)) in row.iter().zip(&offsets).enumerate() {
                    if product - offset > best.0 {
                        best = (product - offset, c as u32);
                    }
                }
                best.1
            };
            products
                .chunks_exact(clusters)
                .map(best)
                .collect::<Vec<_>>()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four groups around the corners of a square.
    fn corners(n: usize) -> Vec<f32> {
        (0..n)
            .flat_map(|i| {
                let jitter = ((i * 37) % 11) as f32 / 110.0;
                [(i % 2) as f32 + jitter, (i / 2 % 2) as f32 - jitter]
            })
            .collect()
    }

    #[test]
    fn finds_separate_groups() {
        let points = corners(400);
        let k_means = KMeans {
            clusters: 4,
            iterations: 20,
            spherical: false,
            seed: 3,
        };
        let centroids = k_means.run(&points, 2);
        let nearest = nearest_by_distance(&centroids, &points, 2);
        for i in 4..400 {
            assert_eq!(nearest[i], nearest[i % 4]);
        }
        let distinct: std::collections::HashSet<_> = nearest[..4].iter().collect();
        assert_eq!(distinct.len(), 4);
    }

    #[test]
    fn same_on_any_number_of_threads() {
        let points = corners(5000);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let k_means = KMeans {
                clusters: 16,
                iterations: 5,
                spherical: true,
                seed: 9,
            };
            pool.install(|| k_means.run(&points, 2))
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn empty_clusters_are_refilled() {
        // 300 equal points: 16 centroids, of which 15 have no member.
        let points = vec![0.5f32; 600];
        let k_means = KMeans {
            clusters: 16,
            iterations: 4,
            spherical: false,
            seed: 0,
        };
        let centroids = k_means.run(&points, 2);
        assert!(centroids.iter().all(|c| (c - 0.5).abs() < 0.01));
    }
}
