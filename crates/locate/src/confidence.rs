//! The confidence of a fix: its support in numbers, and the calibrated probability that it is right.

use grimnet_net::Confidence;
use serde::{Deserialize, Serialize};

use crate::geometry::scale_prior::LOG_ODDS_PER_LOG_INLIERS;

/// The figures from which the confidence of a fix is computed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Support {
    /// Number of matches that agree with the transform.
    pub inliers: usize,
    /// Number of grid cells of the photo that hold inliers. A cell is a twelfth of the photo's mean side wide.
    pub places: usize,
    /// Number of matches.
    pub matches: usize,
    /// Number of inliers of the best candidate at another position; 0 if there is none.
    pub runner_up_inliers: usize,
    /// Standard deviation of the inliers along their short axis, over half the photo's mean side.
    pub spread: f64,
    /// Number of inliers that guided matching would find if the descriptors said nothing.
    pub expected_inliers: f64,
    /// Number of the map's keypoints, apart from the inliers, that the photo shows.
    pub held_back_points: usize,
    /// Mean excess of the similarity of their descriptors to the photo's where the transform maps them over that around these
    /// positions (cosine).
    pub held_back_excess: f64,
    /// Share of the photo that lies on the map, 0 to 1.
    pub on_map: f64,
    /// Covariance of the centre from the inliers alone, before calibration, square metres: east-east, east-north,
    /// north-north.
    pub inlier_covariance_en_m2: [f64; 3],
}

/// Number of inliers that occurs by chance at some position of any map; a runner-up below it is raised to it.
const CHANCE_INLIERS: usize = 10;
/// A runner-up with so many inliers is no chance but another place that looks alike: as [`crate::Options::clear_inliers`]. Of the photos
/// of `seasons` and `fongyuan`, localised with nothing known, the right answers had runner-ups of 42 and fewer.
pub(crate) const ALIKE_INLIERS: usize = 45;
/// Expected numbers of chance inliers below this are raised to it: photos with few keypoints are no better evidence.
const MIN_EXPECTED_INLIERS: f64 = 0.1;
/// The mean excess of so many held-back keypoints counts half, of fewer less.
const HALF_WEIGHT_POINTS: f64 = 50.0;
/// Smaller spreads are raised to this to keep the logarithm finite.
const MIN_SPREAD: f64 = 1e-3;

/// The odds that an answer is right are so many times smaller where the ground width was searched as well: every width is another
/// chance of a wrong answer, and the weights were fitted to photos whose width was given. Of 1,200 photos of other places that were
/// localised with heading and ground width unknown, five had an answer above the calibrated limit, with up to 2.3 times its odds.
const UNKNOWN_WIDTH_ODDS: f64 = 2.4;

/// The probability that an answer is right for which the ground width was searched, from `confidence`, that of the same answer with the
/// width given.
pub(crate) fn with_unknown_width(confidence: f64) -> f64 {
    confidence / (confidence + UNKNOWN_WIDTH_ODDS * (1.0 - confidence))
}

impl Support {
    /// The features of the logistic model: the logarithms of cells, of inliers over those of the runner-up, of inliers over
    /// those that chance gives, and of spread; and the excess of the held-back keypoints, less for few of them.
    pub fn evidence(&self) -> [f64; 5] {
        let inliers = self.inliers.max(1) as f64;
        let held_back = self.held_back_points as f64;
        [
            (self.places.max(1) as f64).ln(),
            (inliers / self.runner_up_inliers.max(CHANCE_INLIERS) as f64).ln(),
            (inliers / self.expected_inliers.max(MIN_EXPECTED_INLIERS)).ln(),
            self.spread.max(MIN_SPREAD).ln(),
            self.held_back_excess * held_back / (held_back + HALF_WEIGHT_POINTS),
        ]
    }

    /// Probability that a fix with this support is right, by a fitted logistic model.
    pub fn confidence(&self, model: &Confidence) -> f64 {
        let weights = [
            model.log_places,
            model.log_lead,
            model.log_excess,
            model.log_spread,
            model.held_back,
        ];
        let weighted = self.evidence().into_iter().zip(weights).map(|(e, w)| e * w);
        let log_odds = model.intercept + weighted.sum::<f64>();
        self.share_against_alike() / (1.0 + (-log_odds).exp())
    }

    /// Probability that of two places that look alike this is the right one; 1 if there is no other. The logistic model was fitted to
    /// maps that hardly have such places: many inliers make it certain however many the other place has.
    fn share_against_alike(&self) -> f64 {
        if self.runner_up_inliers < ALIKE_INLIERS {
            return 1.0;
        }
        let log_lead = (self.inliers.max(1) as f64 / self.runner_up_inliers as f64).ln();
        1.0 / (1.0 + (-LOG_ODDS_PER_LOG_INLIERS * log_lead).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn confidence_is_the_logistic_of_the_weighted_evidence() {
        let support = Support {
            inliers: 20,
            places: 15,
            matches: 40,
            runner_up_inliers: 16,
            spread: 0.5,
            expected_inliers: 0.5,
            held_back_points: 150,
            held_back_excess: 0.2,
            on_map: 1.0,
            inlier_covariance_en_m2: [1.0, 0.0, 1.0],
        };
        let model = Confidence {
            intercept: -3.0,
            log_places: 1.0,
            log_lead: 2.0,
            log_excess: 0.5,
            log_spread: 0.1,
            held_back: 4.0,
            needed: 0.5,
        };
        // -3 + ln 15 + 2 ln 1.25 + 0.5 ln 40 + 0.1 ln 0.5 + 4 * 0.2 * 150 / 200 = 2.529462
        let by_hand = 1.0 / (1.0 + (-2.529_462_f64).exp());
        assert!((support.confidence(&model) - by_hand).abs() < 1e-6);
        let alone = Support {
            runner_up_inliers: 0,
            ..support
        };
        assert!(
            (alone.evidence()[1] - (20.0 / 10.0f64).ln()).abs() < 1e-12,
            "a missing runner-up counts as chance"
        );
    }

    #[test]
    fn one_of_two_places_that_look_alike_is_right_half_the_time() {
        let model = Confidence {
            intercept: 10.0,
            log_places: 0.0,
            log_lead: 0.0,
            log_excess: 0.0,
            log_spread: 0.0,
            held_back: 0.0,
            needed: 0.5,
        };
        let confidence = |inliers, runner_up_inliers| {
            let support = Support {
                inliers,
                places: 60,
                matches: 320,
                runner_up_inliers,
                spread: 0.5,
                expected_inliers: 2.0,
                held_back_points: 150,
                held_back_excess: 0.2,
                on_map: 1.0,
                inlier_covariance_en_m2: [1.0, 0.0, 1.0],
            };
            support.confidence(&model)
        };
        assert!((confidence(240, 240) - 0.5).abs() < 1e-3);
        assert!((0.5..0.6).contains(&confidence(243, 232)));
        assert!(confidence(240, 60) > 0.99);
        // By chance a place of any map has so many.
        assert!(confidence(24, 24) > 0.99);
    }

    #[test]
    fn a_searched_width_divides_the_odds() {
        // Odds of 3 become 1.25, and certainty stays.
        assert!((with_unknown_width(0.75) - 1.25 / 2.25).abs() < 1e-12);
        assert_eq!([0.0, 1.0].map(with_unknown_width), [0.0, 1.0]);
    }
}
