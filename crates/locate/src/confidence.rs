//! How sure a fix is: what supports it, and the probability that the model's calibration gives that support.

use grimnet_net::Confidence;
use serde::{Deserialize, Serialize};

/// What a fix rests on, in numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Support {
    /// Matches that agree with the transform.
    pub inliers: usize,
    /// Places of the photo that they lie in, see [`crate::gates::occupied_places`].
    pub places: usize,
    /// Matches.
    pub matches: usize,
    /// Matches that agree on the best answer at another place; 0 where there is none.
    pub runner_up_inliers: usize,
    /// Standard deviation of the inliers along their short axis over the photo's mean half side.
    pub spread: f64,
    /// Covariance of the centre from the inliers alone, before calibration, square metres: east-east, east-north,
    /// north-north.
    pub inlier_covariance_en_m2: [f64; 3],
}

/// Inliers that chance gives at some place of any map; a weaker runner-up says nothing.
const CHANCE_INLIERS: usize = 10;
/// Below this the inliers lie on a line; keeps the logarithm finite.
const MIN_SPREAD: f64 = 1e-3;

impl Support {
    /// What the calibration weighs: log places, log of inliers over the runner-up's, log of inliers over matches, log spread.
    pub fn evidence(&self) -> [f64; 4] {
        let inliers = self.inliers.max(1) as f64;
        [
            (self.places.max(1) as f64).ln(),
            (inliers / self.runner_up_inliers.max(CHANCE_INLIERS) as f64).ln(),
            (inliers / self.matches.max(1) as f64).ln(),
            self.spread.max(MIN_SPREAD).ln(),
        ]
    }

    /// Probability that a fix with this support is right, by a fitted model.
    pub fn confidence(&self, model: &Confidence) -> f64 {
        let weights = [
            model.log_places,
            model.log_lead,
            model.log_share,
            model.log_spread,
        ];
        let weighed = self.evidence().into_iter().zip(weights).map(|(e, w)| e * w);
        let log_odds = model.intercept + weighed.sum::<f64>();
        1.0 / (1.0 + (-log_odds).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidence_is_the_logistic_of_the_weighed_evidence() {
        let support = Support {
            inliers: 20,
            places: 15,
            matches: 40,
            runner_up_inliers: 16,
            spread: 0.5,
            inlier_covariance_en_m2: [1.0, 0.0, 1.0],
        };
        let model = Confidence {
            intercept: -3.0,
            log_places: 1.0,
            log_lead: 2.0,
            log_share: 0.5,
            log_spread: 0.1,
            needed: 0.5,
        };
        // -3 + ln 15 + 2 ln 1.25 + 0.5 ln 0.5 + 0.1 ln 0.5 = -0.261552
        let by_hand = 1.0 / (1.0 + (0.261_552_f64).exp());
        assert!((support.confidence(&model) - by_hand).abs() < 1e-6);
        let alone = Support {
            runner_up_inliers: 0,
            ..support
        };
        assert!(
            (alone.evidence()[1] - (20.0 / 10.0f64).ln()).abs() < 1e-12,
            "no runner-up counts as chance"
        );
    }
}
