//! Random homographies between the two views of a pair.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Range of the random homographies between the views of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HomographyRange {
    /// Largest rotation either way, degrees.
    pub rotation_deg: f64,
    /// Largest natural logarithm of the scale, either way.
    pub log_scale: f64,
    /// Largest natural logarithm of the ratio of the axes, either way.
    pub log_stretch: f64,
    /// Largest translation either way, as a share of the side.
    pub shift: f64,
    /// Largest additional shift of each corner either way (perspective), as a share of the side.
    pub corner: f64,
}

impl Default for HomographyRange {
    fn default() -> Self {
        Self {
            rotation_deg: 30.0,
            log_scale: 0.3,
            log_stretch: 0.1,
            shift: 0.2,
            corner: 0.05,
        }
    }
}

/// Applies a homography to a point.
pub fn apply(h: &Matrix3<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    let p = h * Vector3::new(x, y, 1.0);
    [p.x / p.z, p.y / p.z]
}

/// The homography that maps four points, no three of them collinear, to four others; `None` if they are degenerate.
pub(super) fn from_corners(from: [[f64; 2]; 4], to: [[f64; 2]; 4]) -> Option<Matrix3<f64>> {
    let mut a = SMatrix::<f64, 8, 8>::zeros();
    let mut b = SVector::<f64, 8>::zeros();
    for i in 0..4 {
        let ([x, y], [u, v]) = (from[i], to[i]);
        a.set_row(
            2 * i,
            &SMatrix::<f64, 1, 8>::from([[x], [y], [1.0], [0.0], [0.0], [0.0], [-u * x], [-u * y]]),
        );
        a.set_row(
            2 * i + 1,
            &SMatrix::<f64, 1, 8>::from([[0.0], [0.0], [0.0], [x], [y], [1.0], [-v * x], [-v * y]]),
        );
        b[2 * i] = u;
        b[2 * i + 1] = v;
    }
    let h = a.lu().solve(&b)?;
    Some(Matrix3::new(
        h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0,
    ))
}

/// A random homography from pixels of one view to pixels of the other, both `side_px` square.
pub fn random_homography(
    range: &HomographyRange,
    side_px: f64,
    random: &mut impl Rng,
) -> Matrix3<f64> {
    let mut either = |bound: f64| {
        if bound > 0.0 {
            random.random_range(-bound..bound)
        } else {
            0.0
        }
    };
    let (sin, cos) = either(range.rotation_deg).to_radians().sin_cos();
    let scale = either(range.log_scale).exp();
    let stretch = either(range.log_stretch).exp();
    let shift = [either(range.shift) * side_px, either(range.shift) * side_px];
    let c = side_px / 2.0;
    let from = [
        [0.0, 0.0],
        [side_px, 0.0],
        [side_px, side_px],
        [0.0, side_px],
    ];
    let to = from.map(|[x, y]| {
        let (x, y) = ((x - c) * scale, (y - c) * scale * stretch);
        [
            cos * x - sin * y + c + shift[0] + either(range.corner) * side_px,
            sin * x + cos * y + c + shift[1] + either(range.corner) * side_px,
        ]
    });
    from_corners(from, to).unwrap_or_else(Matrix3::identity)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn corners_go_where_they_were_sent() {
        let from = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
        let to = [[1.0, 2.0], [9.0, -1.0], [12.0, 13.0], [-2.0, 8.0]];
        let h = from_corners(from, to).unwrap();
        for (from, to) in from.into_iter().zip(to) {
            let [x, y] = apply(&h, from);
            assert!((x - to[0]).abs() < 1e-9 && (y - to[1]).abs() < 1e-9);
        }
    }

    #[test]
    fn an_empty_range_is_the_identity() {
        let none = HomographyRange {
            rotation_deg: 0.0,
            log_scale: 0.0,
            log_stretch: 0.0,
            shift: 0.0,
            corner: 0.0,
        };
        let h = random_homography(&none, 100.0, &mut rand_chacha::ChaCha8Rng::seed_from_u64(1));
        assert!((h - Matrix3::identity()).norm() < 1e-9);
    }
}
