//! Covariance of a mapped point from the weighted normal equations, and the 95 % radius of a covariance.

use nalgebra::{Matrix2, Point2, SMatrix};

use crate::geometry::{
    correspondence::{Correspondence, Normalisation},
    transform::Transform,
};

/// Lower limit of the residuals' standard deviation, pixels per axis: a keypoint is an integer pixel (1 / sqrt(12) in each of the
/// two pictures), and a few pairs can agree by chance.
pub const MIN_RESIDUAL_SIGMA_PX: f64 = 0.41;

/// Covariance of `point` mapped by `model`, square pixels of the picture mapped to.
///
/// The weights are not inverse variances, so the estimate's covariance is that of weighted least
/// squares under equal noise, `N^-1 (J^T W^2 J) N^-1 sigma^2` with `N = J^T W J` the weighted normal equations; for equal
/// weights it is the textbook `N^-1 sigma^2`. `sigma` is the residuals' standard deviation per axis (2 n - N degrees of
/// freedom), not below `min_sigma_px`; with no degree of freedom there are no residuals, and it is `min_sigma_px`.
///
/// Returns `None` if the pairs do not determine the model.
pub fn mapped_point_covariance<const N: usize, T: Transform<N>>(
    model: &T,
    pairs: &[Correspondence],
    point: Point2<f64>,
    min_sigma_px: f64,
) -> Option<Matrix2<f64>> {
    let freedom = (2 * pairs.len()).checked_sub(N)?;
    let from = Normalisation::of(pairs.iter().map(|pair| pair.from))?;
    let to = Normalisation::of(pairs.iter().map(|pair| pair.to))?;
    let scaled = model.normalised(&from, &to)?;
    let (mut normal, mut spread) = (SMatrix::<f64, N, N>::zeros(), SMatrix::<f64, N, N>::zeros());
    let mut squares_px2 = 0.0;
    for pair in pairs {
        let jacobian = scaled.parameter_jacobian(from.apply(pair.from))?;
        let outer = jacobian.transpose() * jacobian;
        normal += outer * pair.weight;
        spread += outer * pair.weight.powi(2);
        squares_px2 += model.squared_error(pair.from, pair.to);
    }
    let variance_px2 = (squares_px2 / freedom.max(1) as f64).max(min_sigma_px.powi(2));
    let factor = normal.cholesky()?;
    let at_point = scaled.parameter_jacobian(from.apply(point))? / to.scale;
    // J N^-1, 2 x N.
    let gain = factor.solve(&at_point.transpose()).transpose();
    let covariance = gain * (spread * variance_px2 * to.scale.powi(2)) * gain.transpose();
    covariance
        .iter()
        .all(|entry| entry.is_finite())
        .then(|| (covariance + covariance.transpose()) * 0.5)
}

/// Propagates a covariance through a linear map: `J C J^T`.
pub fn propagate(covariance: &Matrix2<f64>, jacobian: &Matrix2<f64>) -> Matrix2<f64> {
    jacobian * covariance * jacobian.transpose()
}

/// Radius of the circle around the mean that holds 95 % of a two-dimensional normal distribution; see [`radius`].
pub fn radius95(covariance: &Matrix2<f64>) -> f64 {
    radius(covariance, 0.95)
}

/// Radius of the circle around the mean that holds a share `probability` (above 0, below 1) of a two-dimensional normal
/// distribution; same unit as the square root of the covariance.
///
/// For 95 % it is between 1.96 sigma (all variance along one axis) and 2.45 sigma (a circle). In polar coordinates of the whitened plane the
/// probability of lying outside r is the mean over the angle of `exp(-r^2 / 2 s^2)`, s the standard deviation along that
/// angle; the trapezoid rule converges quickly for a periodic integrand.
pub fn radius(covariance: &Matrix2<f64>, probability: f64) -> f64 {
    let (mean, half_difference) = (
        covariance.trace() / 2.0,
        (covariance[(0, 0)] - covariance[(1, 1)]) / 2.0,
    );
    let apart = half_difference.hypot((covariance[(0, 1)] + covariance[(1, 0)]) / 2.0);
    let (major, minor) = (mean + apart, (mean - apart).max(0.0));
    if !(major > 0.0 && major.is_finite()) {
        return if major == 0.0 { 0.0 } else { f64::NAN };
    }
    let ratio = minor / major;
    let outside = |r: f64| {
        const ANGLES: usize = 512;
        let sum: f64 = (0..ANGLES)
            .map(|i| {
                let (sin, cos) =
                    ((i as f64 + 0.5) * std::f64::consts::PI / ANGLES as f64).sin_cos();
                (-r * r / (2.0 * (cos * cos + ratio * sin * sin))).exp()
            })
            .sum();
        sum / ANGLES as f64
    };
    // The radius is largest for a circle.
    let (mut low, mut high) = (0.0, (-2.0 * (1.0 - probability).ln()).sqrt());
    for _ in 0..52 {
        let middle = 0.5 * (low + high);
        if outside(middle) > 1.0 - probability {
            low = middle
        } else {
            high = middle
        }
    }
    0.5 * (low + high) * major.sqrt()
}
