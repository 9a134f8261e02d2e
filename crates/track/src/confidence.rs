//! What the confidence of fixes says of a hypothesis, beside where they lie.
//!
//! A calibrated confidence is the probability that a fix is right, given all that the localiser saw, if as many fixes are wrong as
//! where it was calibrated. What counts here is by how much likelier it is among the right fixes of this flight than among the
//! wrong ones: over a town where right fixes are sure of themselves, a place that is only fairly sure is suspect; where wrong
//! fixes are as sure as right ones, confidence says nothing.

/// Fixes over which the statistics are taken.
const FIXES_REMEMBERED: f64 = 200.0;
/// What is assumed before any fix, as so many of each kind: a calibrated confidence with four right fixes of five. The logarithms
/// of the odds of right and wrong ones are then normal with one variance, their means as far apart as that variance.
const PRIOR_FIXES: f64 = 10.0;
const PRIOR_SHARE_RIGHT: f64 = 0.8;
const PRIOR_VARIANCE: f64 = 5.76;
/// However alike the confidences were, the next one may differ: least variance of the logarithm of the odds.
const LEAST_VARIANCE: f64 = 1.0;
/// One fix says no more than this, either way: the statistics are of few fixes and not normal.
const MOST_LOG_RATIO: f64 = 6.0;
/// No confidence counts for less than this.
const LEAST_CONFIDENCE: f64 = 0.01;
/// Correlation of the scores of fixes of one place: a wrong place that looks right in one photo does so in the next.
const CORRELATION: f64 = 0.35;

fn log_odds(confidence: f64, full: f64) -> f64 {
    let probability = confidence.clamp(LEAST_CONFIDENCE, full);
    (probability / (1.0 - probability)).ln()
}

/// Mean and variance of values of which the older ones count less.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Moments {
    count: f64,
    sum: f64,
    sum_of_squares: f64,
}

impl Moments {
    fn new(count: f64, mean: f64, variance: f64) -> Self {
        Self {
            count,
            sum: count * mean,
            sum_of_squares: count * (variance + mean * mean),
        }
    }

    fn add(&mut self, value: f64) {
        let remain = 1.0 - 1.0 / FIXES_REMEMBERED;
        self.count = self.count * remain + 1.0;
        self.sum = self.sum * remain + value;
        self.sum_of_squares = self.sum_of_squares * remain + value * value;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }

    fn variance(&self) -> f64 {
        (self.sum_of_squares / self.count - self.mean().powi(2)).max(LEAST_VARIANCE)
    }

    /// Logarithm of the normal density, but for a constant.
    fn log_density(&self, value: f64) -> f64 {
        let variance = self.variance();
        -0.5 * ((value - self.mean()).powi(2) / variance + variance.ln())
    }
}

/// The confidences of right and of wrong fixes, as far as the flight has shown which was which.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ConfidenceOdds {
    right: Moments,
    wrong: Moments,
    /// Those of wrong fixes since the last right one: if none follows, it is not they that are wrong.
    run: Moments,
}

impl Default for ConfidenceOdds {
    fn default() -> Self {
        let middle = (PRIOR_SHARE_RIGHT / (1.0 - PRIOR_SHARE_RIGHT)).ln();
        let prior = |mean| Moments::new(PRIOR_FIXES, mean, PRIOR_VARIANCE);
        Self {
            right: prior(middle + 0.5 * PRIOR_VARIANCE),
            wrong: prior(middle - 0.5 * PRIOR_VARIANCE),
            run: Moments::new(0.0, 0.0, 0.0),
        }
    }
}

impl ConfidenceOdds {
    /// Logarithm of how much likelier a confidence is among right fixes than among wrong ones. Confidences above `full` count as
    /// `full`.
    pub fn log_ratio(&self, confidence: f64, full: f64) -> f64 {
        let (least, most) = (self.wrong.mean(), self.right.mean());
        if least >= most {
            return 0.0;
        }
        // A confidence beyond the mean of either kind speaks as clearly for that kind as the mean does.
        let value = log_odds(confidence, full).clamp(least, most);
        (self.right.log_density(value) - self.wrong.log_density(value))
            .clamp(-MOST_LOG_RATIO, MOST_LOG_RATIO)
    }

    /// Counts a fix that the leader took for right or wrong.
    pub fn count(&mut self, confidence: f64, full: f64, right: bool) {
        let value = log_odds(confidence, full);
        if !right {
            self.run.count += 1.0;
            self.run.sum += value;
            self.run.sum_of_squares += value * value;
            return;
        }
        self.right.add(value);
        if self.run.count > 0.0 {
            let remain = (1.0 - 1.0 / FIXES_REMEMBERED).powf(self.run.count);
            self.wrong = Moments {
                count: self.wrong.count * remain + self.run.count,
                sum: self.wrong.sum * remain + self.run.sum,
                sum_of_squares: self.wrong.sum_of_squares * remain + self.run.sum_of_squares,
            };
        }
        self.forget_run();
    }

    /// Another hypothesis leads: the run was none.
    pub fn forget_run(&mut self) {
        self.run = Moments::new(0.0, 0.0, 0.0);
    }
}

/// Fixes in a row that a hypothesis accepted, and what their confidence says together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Support {
    fixes: u32,
    log_odds: f64,
}

impl Support {
    /// Adds a fix. Gives by how much it raises the logarithm of the odds: `n` fixes of correlation `r` say as much as
    /// `n / (1 + (n - 1) r)` independent ones (Kish, "Survey Sampling" (1965), section 5.4).
    pub fn add(&mut self, log_odds: f64) -> f64 {
        let before = self.total();
        self.fixes = self.fixes.saturating_add(1);
        self.log_odds += log_odds;
        self.total() - before
    }

    fn total(&self) -> f64 {
        self.log_odds / (1.0 + CORRELATION * (f64::from(self.fixes) - 1.0).max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn before_any_fix_a_calibrated_confidence_is_taken_by_its_word() {
        let odds = ConfidenceOdds::default();
        // Odds of 19 over odds of 4.
        let expected = (19f64 / 4.0).ln();
        assert_relative_eq!(odds.log_ratio(0.95, 0.99), expected, epsilon = 1e-9);
        assert_relative_eq!(odds.log_ratio(0.8, 0.99), 0.0, epsilon = 1e-9);
        assert_eq!(odds.log_ratio(1.0, 0.95), odds.log_ratio(0.95, 0.95));
        assert!(odds.log_ratio(0.0, 0.95).is_finite());
    }

    #[test]
    fn what_counts_is_how_right_and_wrong_fixes_of_this_flight_differ() {
        let flown = |right: f64, wrong: f64| {
            let mut odds = ConfidenceOdds::default();
            for fix in 0..1000 {
                let is_right = fix % 5 != 0;
                odds.count(if is_right { right } else { wrong }, 0.998, is_right);
            }
            odds
        };
        let (sure, alike) = (flown(0.999, 0.2), flown(0.9, 0.9));
        // Where right fixes are sure, a place that is only fairly sure is suspect. By hand, with the least variance: the logarithms
        // of the odds are 6.2 and -1.4 in the mean and 2.2 here, so (3.6^2 - 4.0^2) / 2.
        assert_relative_eq!(sure.log_ratio(0.9, 0.998), -1.6, epsilon = 0.1);
        assert!(sure.log_ratio(0.998, 0.998) > 3.0);
        assert!(alike.log_ratio(0.9, 0.998).abs() < 0.3);
        // A run that does not end is not of wrong fixes.
        let mut moved = sure;
        for _ in 0..100 {
            moved.count(0.999, 0.998, false);
        }
        assert_eq!(moved.log_ratio(0.9, 0.998), sure.log_ratio(0.9, 0.998));
    }

    #[test]
    fn many_fixes_of_one_place_say_no_more_than_a_few_independent_ones() {
        let mut support = Support::default();
        assert_relative_eq!(support.add(3.0), 3.0);
        // Two count as 2 / 1.35.
        assert_relative_eq!(support.add(3.0), 3.0 * (2.0 / 1.35 - 1.0), epsilon = 1e-12);
        let total = 6.0 / 1.35 + (0..1000).map(|_| support.add(3.0)).sum::<f64>();
        assert!((8.4..3.0 / CORRELATION).contains(&total), "{total}");
    }
}
