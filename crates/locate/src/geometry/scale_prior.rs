//! What is known of a transform's scale before any point is matched.

/// How probable the scales of a transform are: of the stated ground width, by its sigma.
///
/// The logarithm of the ratio to the most probable scale has a Laplace distribution, and one stated width in twenty is simply wrong. With
/// it, of two planes that a photo shows, such as a roof and the ground beside it, the one at the stated distance is matched even if it
/// has fewer inliers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScalePrior {
    /// The most probable scale.
    pub scale: f64,
    /// Relative 1-sigma: 0.15 says 15 %.
    pub relative_sigma: f64,
}

/// Share of stated widths that are wrong altogether.
const WRONG_SHARE: f64 = 0.05;
/// What the logarithm of the number of inliers adds to the log-odds of an answer: its lead and its excess over chance in the
/// calibration of the bundled model (`grimnet_net::Confidence`).
pub(crate) const LOG_ODDS_PER_LOG_INLIERS: f64 = 4.8;

impl ScalePrior {
    /// What an inlier of a transform of this scale counts as, compared with one of the most probable scale: the number of inliers times
    /// this has the same log-odds.
    pub fn inlier_weight(&self, scale: f64) -> f64 {
        let away = (scale / self.scale).ln().abs() / self.relative_sigma;
        let log_density = (-std::f64::consts::SQRT_2 * away).max(WRONG_SHARE.ln());
        (log_density / LOG_ODDS_PER_LOG_INLIERS).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inliers_count_less_away_from_the_stated_scale_but_never_nothing() {
        let prior = ScalePrior {
            scale: 2.0,
            relative_sigma: 0.15,
        };
        assert_eq!(prior.inlier_weight(2.0), 1.0);
        // exp(-sqrt(2) ln(5/4) / 0.15 / 4.8)
        assert!((prior.inlier_weight(1.6) - 0.645_14).abs() < 1e-4);
        assert!((prior.inlier_weight(1.6) - prior.inlier_weight(2.5)).abs() < 1e-12);
        // exp(ln(0.05) / 4.8)
        assert!((prior.inlier_weight(20.0) - 0.535_74).abs() < 1e-4);
    }
}
