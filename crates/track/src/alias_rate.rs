//! How often fixes are of another place, and how long that lasts, learned during the flight.

/// Fixes over which the shares are remembered.
const FIXES_REMEMBERED: f64 = 200.0;
/// What is assumed before any fix, as counts: of twenty fixes after a right one, one is wrong.
const PRIOR_STARTED: f64 = 1.0;
const PRIOR_RIGHT: f64 = 20.0;
/// Of four fixes after a wrong one, one is wrong at the same offset, or two before any right fix: until a flight has shown how
/// places look that are alike, one of them may repeat for long.
const PRIOR_CONTINUED: [f64; 2] = [1.0, 2.0];
/// After so many right fixes half of that difference is left.
const PRIOR_HALVED_BY: f64 = 90.0;
const PRIOR_WRONG: f64 = 4.0;

/// However long runs of wrong fixes were, a new place is believed at last.
const MOST_CONTINUED: f64 = 0.75;

/// A two-state Markov chain of right and wrong fixes, with its transition probabilities counted.
///
/// A run of wrong fixes counts when it ended with a right one: a run that does not end is not of wrong fixes, the hypothesis
/// is.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct AliasRate {
    started: f64,
    after_right: f64,
    continued: f64,
    after_wrong: f64,
    /// Wrong fixes since the last right one.
    run: u32,
}

impl AliasRate {
    /// Counts a fix that the leader took for right or wrong.
    pub fn count(&mut self, right: bool) {
        if !right {
            self.run = self.run.saturating_add(1);
            return;
        }
        let remain = 1.0 - 1.0 / FIXES_REMEMBERED;
        for count in [
            &mut self.started,
            &mut self.after_right,
            &mut self.continued,
            &mut self.after_wrong,
        ] {
            *count *= remain;
        }
        // The fix after the right one before: this one, or the first one of the run.
        self.after_right += 1.0;
        if self.run > 0 {
            self.started += 1.0;
            self.continued += f64::from(self.run - 1);
            self.after_wrong += f64::from(self.run);
        }
        self.run = 0;
    }

    /// Another hypothesis leads: the run was none.
    pub fn forget_run(&mut self) {
        self.run = 0;
    }

    /// Probability that a fix is wrong, given whether the one before was.
    pub fn wrong(&self, after_wrong: bool) -> f64 {
        if after_wrong {
            let [least, most] = PRIOR_CONTINUED;
            let early = PRIOR_HALVED_BY / (PRIOR_HALVED_BY + self.after_right);
            let prior = least + (most - least) * early;
            // Places that look alike differ in how long they do: the run itself tells that this one lasts, if it is one.
            let run = f64::from(self.run);
            let counted = (self.continued + prior + run) / (self.after_wrong + PRIOR_WRONG + run);
            counted.min(MOST_CONTINUED)
        } else {
            (self.started + PRIOR_STARTED) / (self.after_right + PRIOR_RIGHT)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_learned_and_a_run_tells_of_itself() {
        let mut rate = AliasRate::default();
        assert!((rate.wrong(false) - 0.05).abs() < 1e-12);
        // Every fifth fix begins a run of two wrong ones.
        for fix in 0..2000 {
            rate.count(fix % 5 > 1);
        }
        // Of three fixes after a right one, one is wrong; what is assumed before any fix counts for one tenth.
        assert!((rate.wrong(false) - 0.31).abs() < 0.02, "{rate:?}");
        assert!((rate.wrong(true) - 0.5).abs() < 0.02, "{rate:?}");
        let before = rate.wrong(true);
        (0..30).for_each(|_| rate.count(false));
        assert!(rate.wrong(true) > before + 0.05, "{rate:?}");
        (0..3000).for_each(|_| rate.count(false));
        assert_eq!(rate.wrong(true), MOST_CONTINUED);
        rate.forget_run();
        assert_eq!(rate.wrong(true), before);
    }
}
