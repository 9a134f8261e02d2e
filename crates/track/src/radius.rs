//! The radius that holds 95 % of a two-dimensional normal distribution.

use nalgebra::Matrix2;

/// Radius over the larger standard deviation, for ratios of the smaller to the larger from 0 to 1 in steps of 0.1. H. L.
/// Harter, "Circular Error Probabilities", J. American Statistical Association 55 (1960), table 1, P = 0.95.
const RADIUS95: [f64; 11] = [
    1.95996, 1.96253, 1.97041, 1.98420, 2.00514, 2.03586, 2.08130, 2.14598, 2.23029, 2.33180,
    2.44775,
];

/// Radius of the circle around the mean that holds 95 %. Interpolated; right to 0.3 %, never too small by more than 1e-4.
pub fn radius95_m(covariance_m2: &Matrix2<f64>) -> f64 {
    let (mean, half_difference) = (
        0.5 * covariance_m2.trace(),
        0.5 * (covariance_m2[(0, 0)] - covariance_m2[(1, 1)]),
    );
    let apart = half_difference.hypot(0.5 * (covariance_m2[(0, 1)] + covariance_m2[(1, 0)]));
    let (major, minor) = (mean + apart, (mean - apart).max(0.0));
    if !(major.is_finite() && major > 0.0) {
        return if major == 0.0 { 0.0 } else { f64::INFINITY };
    }
    let last = RADIUS95.len() - 1;
    let at = (minor / major).sqrt() * last as f64;
    let below = (at.floor() as usize).min(last - 1);
    let share = at - below as f64;
    let factor = RADIUS95[below] * (1.0 - share) + RADIUS95[below + 1] * share;
    factor * major.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of the distribution outside of a circle, in polar coordinates of the whitened plane.
    fn outside(radius: f64, ratio: f64) -> f64 {
        let angles = 20_000;
        let sum: f64 = (0..angles)
            .map(|i| {
                let (sin, cos) =
                    ((f64::from(i) + 0.5) * std::f64::consts::PI / f64::from(angles)).sin_cos();
                (-radius * radius / (2.0 * (cos * cos + ratio * ratio * sin * sin))).exp()
            })
            .sum();
        sum / f64::from(angles)
    }

    #[test]
    fn five_per_cent_lie_outside() {
        for step in 1..=100 {
            let ratio = f64::from(step) / 100.0;
            let (sin, cos) = 0.7f64.sin_cos();
            let turn = Matrix2::new(cos, -sin, sin, cos);
            let covariance =
                turn * Matrix2::new(9.0, 0.0, 0.0, 9.0 * ratio * ratio) * turn.transpose();
            let share = outside(radius95_m(&covariance) / 3.0, ratio);
            assert!((0.0485..=0.0501).contains(&share), "{ratio}: {share}");
        }
        assert_eq!(radius95_m(&Matrix2::zeros()), 0.0);
    }
}
