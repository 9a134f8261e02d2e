//! Matching and homography estimation for validation, independent of the localiser's.

use crate::data::apply;
use nalgebra::{Matrix3, SMatrix, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// RANSAC iterations.
const ITERATIONS: usize = 500;
/// Fewest inliers of a homography.
const LEAST_INLIERS: usize = 6;
/// Inlier threshold, pixels.
const INLIER_PX: f64 = 3.0;

/// Mutual nearest neighbours of two sets of descriptors (rows of `d` values, unit length), as pairs of row numbers.
pub(super) fn mutual_matches(a: &[f32], b: &[f32], d: usize) -> Vec<(usize, usize)> {
    let (n, m) = (a.len() / d, b.len() / d);
    if n == 0 || m == 0 {
        return Vec::new();
    }
    let mut forth = vec![(0, f32::MIN); n];
    let mut back = vec![(0, f32::MIN); m];
    for (i, x) in a.chunks_exact(d).enumerate() {
        for (j, y) in b.chunks_exact(d).enumerate() {
            let s: f32 = x.iter().zip(y).map(|(x, y)| x * y).sum();
            if s > forth[i].1 {
                forth[i] = (j, s);
            }
            if s > back[j].1 {
                back[j] = (i, s);
            }
        }
    }
    (0..n)
        .filter(|i| back[forth[*i].0].0 == *i)
        .map(|i| (i, forth[i].0))
        .collect()
}

/// Corresponding points of two views, pixels.
pub(super) type Match = ([f64; 2], [f64; 2]);

/// Homography of least squares by the normalised DLT (Hartley 1997).
fn fit(matches: &[Match]) -> Option<Matrix3<f64>> {
    let normaliser = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let points: Vec<[f64; 2]> = points.collect();
        let n = points.len() as f64;
        let c = points
            .iter()
            .fold([0.0, 0.0], |s, p| [s[0] + p[0] / n, s[1] + p[1] / n]);
        let spread = points
            .iter()
            .map(|p| (p[0] - c[0]).hypot(p[1] - c[1]))
            .sum::<f64>()
            / n;
        let s = std::f64::consts::SQRT_2 / spread.max(1e-9);
        Matrix3::new(s, 0.0, -s * c[0], 0.0, s, -s * c[1], 0.0, 0.0, 1.0)
    };
    let (t, u) = (
        normaliser(&mut matches.iter().map(|m| m.0)),
        normaliser(&mut matches.iter().map(|m| m.1)),
    );
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in matches {
        let p = t * Vector3::new(p[0], p[1], 1.0);
        let q = u * Vector3::new(q[0], q[1], 1.0);
        let rows = [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
        ];
        for row in rows {
            let row = SMatrix::<f64, 9, 1>::from(row);
            normal += row * row.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let h = eigen.eigenvectors.column(least);
    let h = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    Some(u.try_inverse()? * h * t)
}

/// Homography by RANSAC, refitted to its inliers; `None` if there are too few of them.
pub(super) fn ransac(matches: &[Match], random: &mut ChaCha8Rng) -> Option<Matrix3<f64>> {
    if matches.len() < LEAST_INLIERS {
        return None;
    }
    let inliers = |h: &Matrix3<f64>| -> Vec<Match> {
        let fits = |(p, q): &&Match| {
            let [x, y] = apply(h, *p);
            (x - q[0]).hypot(y - q[1]) < INLIER_PX
        };
        matches.iter().filter(fits).copied().collect()
    };
    let mut best = Vec::new();
    for _ in 0..ITERATIONS {
        let sample: Vec<Match> = (0..4)
            .map(|_| matches[random.random_range(0..matches.len())])
            .collect();
        if let Some(found) = fit(&sample).map(|h| inliers(&h))
            && found.len() > best.len()
        {
            best = found;
        }
    }
    if best.len() < LEAST_INLIERS {
        return None;
    }
    let refined = fit(&best)?;
    fit(&inliers(&refined)).or(Some(refined))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn ransac_finds_a_homography_among_wrong_matches() {
        let truth = Matrix3::new(1.1, 0.1, 5.0, -0.08, 0.95, 3.0, 1e-4, -2e-4, 1.0);
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let matches: Vec<Match> = (0..80)
            .map(|i| {
                let p = [
                    random.random_range(0.0..200.0),
                    random.random_range(0.0..200.0),
                ];
                let q = apply(&truth, p);
                (
                    p,
                    if i % 2 == 0 {
                        q
                    } else {
                        [random.random_range(0.0..200.0), q[0]]
                    },
                )
            })
            .collect();
        let found = ransac(&matches, &mut random).unwrap();
        for p in [[0.0, 0.0], [200.0, 0.0], [100.0, 150.0]] {
            let (a, b) = (apply(&found, p), apply(&truth, p));
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-3);
        }
    }
}
