//! Fits the stated covariance to the covariance of the inliers: two numbers by maximum likelihood, then scaled so that the stated
//! 95 % radius contains 95 % of the errors (split conformal prediction, Lei et al. 2018).

use grimnet_locate::internals::covariance::radius95;
use grimnet_net::PositionError;
use nalgebra::{Matrix2, Vector2};

use super::error::FitError;
use super::observation::{Answer, Observation};

/// Least number of right answers for an estimate of a 95 % quantile.
const MIN_FIXES: usize = 40;

/// Degrees of freedom of the Student distribution whose likelihood is maximised: errors have heavier tails than a normal distribution,
/// and a few large ones must not determine the shape (Lange, Little & Taylor 1989 recommend 4).
const STUDENT_FREEDOM: f64 = 4.0;

/// Ranges of the first grid; its refinements may go a little beyond, as they did for the bundled model (0.05 px).
const INLIER_FACTOR_RANGE: (f64, f64) = (0.05, 400.0);
const SHARED_PX_RANGE: (f64, f64) = (0.05, 20.0);

/// The stated covariance of an answer, square metres, without the map's own error.
#[must_use]
pub fn covariance_m2(answer: &Answer, error: &PositionError) -> Matrix2<f64> {
    let [ee, en, nn] = answer.support.inlier_covariance_en_m2;
    let shared_m2 = (error.shared_px * answer.level_gsd_m).powi(2);
    Matrix2::new(ee, en, en, nn) * error.inlier_factor + Matrix2::identity() * shared_m2
}

/// The stated 95 % radius of an answer, metres, without the map's own error.
#[must_use]
pub fn radius95_m(answer: &Answer, error: &PositionError) -> f64 {
    radius95(&covariance_m2(answer, error))
}

/// Fits the two numbers to the right answers among `observations` of which the truth is exact.
///
/// # Errors
/// Too few right answers.
pub fn fit(observations: &[Observation]) -> Result<PositionError, FitError> {
    let right: Vec<Answer> = observations
        .iter()
        .filter(|o| o.is_right() && !o.real)
        .filter_map(|o| o.answer)
        .collect();
    if right.len() < MIN_FIXES {
        return Err(FitError::TooFewFixes {
            found: right.len(),
            needed: MIN_FIXES,
        });
    }
    let shape = likeliest(&right);
    let mut ratios: Vec<f64> = right
        .iter()
        .map(|answer| answer.error_m() / radius95_m(answer, &shape))
        .collect();
    ratios.sort_by(f64::total_cmp);
    // The smallest value that at least 95 % of n + 1 exchangeable errors do not exceed.
    let rank = ((right.len() + 1) as f64 * 0.95).ceil() as usize;
    let scale = ratios[rank.min(ratios.len()) - 1];
    Ok(PositionError {
        inlier_factor: shape.inlier_factor * scale * scale,
        shared_px: shape.shared_px * scale,
    })
}

/// The pair of the largest likelihood: a grid that is refined around its best point.
fn likeliest(right: &[Answer]) -> PositionError {
    const STEPS: usize = 12;
    const REFINEMENTS: usize = 6;
    let mut factor = log_range(INLIER_FACTOR_RANGE);
    let mut shared = log_range(SHARED_PX_RANGE);
    let mut best = PositionError::default();
    for _ in 0..REFINEMENTS {
        let along =
            |(low, high): (f64, f64), i: usize| low + (high - low) * i as f64 / STEPS as f64;
        let mut best_value = f64::NEG_INFINITY;
        for i in 0..=STEPS {
            for j in 0..=STEPS {
                let tried = PositionError {
                    inlier_factor: along(factor, i).exp(),
                    shared_px: along(shared, j).exp(),
                };
                let value: f64 = right.iter().map(|a| log_likelihood(a, &tried)).sum();
                if value > best_value {
                    (best_value, best) = (value, tried);
                }
            }
        }
        factor = around(factor, best.inlier_factor.ln(), STEPS);
        shared = around(shared, best.shared_px.ln(), STEPS);
    }
    best
}

fn log_range((low, high): (f64, f64)) -> (f64, f64) {
    (low.ln(), high.ln())
}

/// Two grid steps about `centre`.
fn around((low, high): (f64, f64), centre: f64, steps: usize) -> (f64, f64) {
    let reach = 2.0 * (high - low) / steps as f64;
    (centre - reach, centre + reach)
}

/// Of a bivariate Student distribution with this covariance as its scale, up to a constant.
fn log_likelihood(answer: &Answer, error: &PositionError) -> f64 {
    let covariance = covariance_m2(answer, error);
    let off = Vector2::new(answer.error_east_m, answer.error_north_m);
    let Some(inverse) = covariance.try_inverse() else {
        return f64::NEG_INFINITY;
    };
    let distance2 = (off.transpose() * inverse * off)[(0, 0)];
    -0.5 * covariance.determinant().ln()
        - (STUDENT_FREEDOM + 2.0) / 2.0 * (1.0 + distance2 / STUDENT_FREEDOM).ln()
}
