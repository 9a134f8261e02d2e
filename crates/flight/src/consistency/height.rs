//! Whether the height of the telemetry is that which the photos show.
//!
//! The ground resolution of a fix times the focal length is the height above the ground. Feet, heights above the sea or above the place
//! of take-off, and a wrong field of view differ from it by a factor that is the same in fix after fix. No photo is found where the
//! height puts its scale wrong, so the searches try other scales while no fix has confirmed it, and again after a gap in the fixes
//! ([`super::confirmation`]).

use std::collections::VecDeque;

use super::confirmation::Confirmation;
use super::median::median;

/// So many of the latest fixes are compared.
const FIXES: usize = 8;
/// So many of them must contradict.
const NEEDED: usize = 6;
/// A height within this factor of that of a fix is confirmed by it: roofs and slopes are nearer than the ground below.
const CONFIRMED: f64 = 1.35;

/// The reported height is not that of the photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeightWarning {
    /// Reported height over that which the latest fixes show with the stated field of view, median.
    pub factor: f64,
    /// Height above ground that the latest fix shows, metres.
    pub measured_m: f64,
}

impl std::fmt::Display for HeightWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the heights of the telemetry are {:.2} times those that the fixes show ({:.0} m with this field of view): metres above the \
             ground below were expected",
            self.factor, self.measured_m
        )
    }
}

/// Compares the reported height with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct HeightCheck {
    confirmation: Confirmation,
    /// Reported over measured heights, the latest last.
    factors: VecDeque<f64>,
    warning: Option<HeightWarning>,
}

impl HeightCheck {
    /// Takes in the height above ground that a fix shows and the one that was reported for it, metres.
    pub fn fix(&mut self, measured_m: f64, reported_m: f64) {
        let factor = reported_m / measured_m;
        if factor.ln().abs() < CONFIRMED.ln() {
            self.confirmation = Confirmation::Holds;
        }
        if self.factors.len() == FIXES {
            self.factors.pop_front();
        }
        self.factors.push_back(factor);
        let middle = median(self.factors.iter().copied());
        let agreeing = |factor: &&f64| {
            (*factor / middle).ln().abs() < CONFIRMED.ln() && factor.ln().abs() > CONFIRMED.ln()
        };
        if self.factors.iter().filter(agreeing).count() >= NEEDED && self.warning.is_none() {
            self.warning = Some(HeightWarning {
                factor: middle,
                measured_m,
            });
        }
    }

    /// The whole map was searched so often in a row without a fix.
    pub fn searched_without_fix(&mut self, searches_without_fix: u32) {
        self.confirmation.searched_without_fix(searches_without_fix);
    }

    /// Whether searches are to try other scales than the reported height's.
    pub fn is_tested(&self, searches_without_fix: u32) -> bool {
        self.confirmation.is_tested(searches_without_fix)
    }

    /// What is inconsistent; once it is, it stays so.
    pub fn warning(&self) -> Option<HeightWarning> {
        self.warning
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(reported_over_measured: impl Fn(usize) -> f64) -> HeightCheck {
        let mut check = HeightCheck::default();
        for number in 0..20 {
            check.fix(100.0, 100.0 * reported_over_measured(number));
        }
        check
    }

    #[test]
    fn a_height_that_gets_another_reference_in_flight_is_noticed() {
        let stepped = flown(|number| if number < 12 { 1.0 } else { 0.52 });
        assert_eq!(stepped.warning().unwrap().factor, 0.52);
        let mut check = flown(|_| 1.0);
        check.searched_without_fix(4);
        assert!(check.is_tested(4));
        check.fix(100.0, 105.0);
        assert!(!check.is_tested(4));
    }

    #[test]
    fn feet_are_noticed_and_roofs_and_wrong_fixes_are_consistent() {
        let feet = flown(|number| if number % 7 == 3 { 0.4 } else { 3.28 });
        let warning = feet.warning().unwrap();
        assert_eq!(warning.factor, 3.28);
        assert_eq!(feet.confirmation, Confirmation::None);
        assert!(warning.to_string().contains("3.28 times"), "{warning}");
        let roofs = flown(|number| 1.0 + 0.03 * (number % 10) as f64);
        assert_eq!(roofs.warning(), None);
        assert_eq!(roofs.confirmation, Confirmation::Holds);
        let wrong = flown(|number| [0.3, 1.0, 2.8, 5.0][number % 4]);
        assert_eq!(wrong.warning(), None, "they agree on no factor");
    }
}
