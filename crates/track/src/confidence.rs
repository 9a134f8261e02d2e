//! What the confidence of fixes says of a hypothesis, beside where they lie.
//!
//! A calibrated confidence is the probability that a fix is right, given all that the localiser saw. Where wrong fixes are usual a
//! confidence of 0.9 says much, where none are it says nothing: what counts are its odds over those of a usual fix.

/// Confidences over which the mean is taken.
const FIXES_REMEMBERED: f64 = 100.0;
/// What is assumed before any fix: so many with this mean.
const PRIOR_FIXES: f64 = 10.0;
const PRIOR_MEAN: f64 = 0.8;
/// No confidence counts for less than this.
const LEAST_CONFIDENCE: f64 = 0.01;
/// Correlation of the scores of fixes of one place: a wrong place that looks right in one photo does so in the next.
const CORRELATION: f64 = 0.4;

fn log_odds(probability: f64) -> f64 {
    (probability / (1.0 - probability)).ln()
}

/// The mean confidence of the latest fixes. It is the share of right ones, if the confidence is calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct UsualConfidence {
    sum: f64,
    fixes: f64,
}

impl Default for UsualConfidence {
    fn default() -> Self {
        Self {
            sum: PRIOR_FIXES * PRIOR_MEAN,
            fixes: PRIOR_FIXES,
        }
    }
}

impl UsualConfidence {
    /// Logarithm of the odds of a fix being right, over those of a usual fix. Confidences above `full` count as `full`.
    pub fn log_odds_of(&self, confidence: f64, full: f64) -> f64 {
        let usual = (self.sum / self.fixes).clamp(LEAST_CONFIDENCE, full);
        log_odds(confidence.clamp(LEAST_CONFIDENCE, full)) - log_odds(usual)
    }

    /// Counts a fix.
    pub fn count(&mut self, confidence: f64) {
        let remain = 1.0 - 1.0 / FIXES_REMEMBERED;
        self.sum = self.sum * remain + confidence;
        self.fixes = self.fixes * remain + 1.0;
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
    fn only_an_unusual_confidence_says_something() {
        let mut usual = UsualConfidence::default();
        for _ in 0..1000 {
            usual.count(0.8);
        }
        assert_relative_eq!(usual.log_odds_of(0.8, 0.99), 0.0, epsilon = 1e-3);
        // Odds of 19 over odds of 4.
        assert_relative_eq!(
            usual.log_odds_of(0.95, 0.99),
            (19f64 / 4.0).ln(),
            epsilon = 1e-3
        );
        assert_eq!(usual.log_odds_of(1.0, 0.95), usual.log_odds_of(0.95, 0.95));
        assert!(usual.log_odds_of(0.0, 0.95).is_finite());
    }

    #[test]
    fn many_fixes_of_one_place_say_no_more_than_a_few_independent_ones() {
        let mut support = Support::default();
        assert_relative_eq!(support.add(3.0), 3.0);
        // Two count as 2 / 1.4.
        assert_relative_eq!(support.add(3.0), 3.0 * (2.0 / 1.4 - 1.0), epsilon = 1e-12);
        let total = 6.0 / 1.4 + (0..1000).map(|_| support.add(3.0)).sum::<f64>();
        assert!((7.4..3.0 / CORRELATION).contains(&total), "{total}");
    }
}
