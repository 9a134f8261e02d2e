//! Whether the yaw of the telemetry is the heading that fixes show.
//!
//! A yaw of another convention (counter-clockwise, in radians, of the tail) makes every search look under a wrong heading, so that none
//! gives a fix. So does a yaw that was reset in flight, by as much in fix after fix. Where the whole map was searched without a fix under
//! a yaw that no fix has confirmed lately ([`super::confirmation`]), it is searched under every heading as well, and the fixes of that
//! tell.

use grimnet_geo::turn_deg;

use super::confirmation::Confirmation;

/// A fix whose heading is this near to the reported yaw confirms it, degrees: far beyond the error of a compass.
const CONFIRMED_DEG: f64 = 40.0;
/// So many fixes in a row must contradict: fixes of wrong places have any heading.
const NEEDED: usize = 4;

/// The reported yaw is not the heading of the photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct YawWarning {
    /// From the headings of the first fixes to the reported yaw, degrees clockwise: the smallest and the largest.
    pub off_deg: [f64; 2],
}

impl std::fmt::Display for YawWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [least, most] = self.off_deg.map(|off_deg| format!("{off_deg:.0}"));
        let range = if least == most {
            least
        } else {
            format!("{least} to {most}")
        };
        write!(
            f,
            "the yaw of the telemetry is {range} degrees off the headings of the fixes: degrees clockwise from true \
             north were expected"
        )
    }
}

/// Compares the reported yaw with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct YawCheck {
    confirmation: Confirmation,
    /// Fixes in a row that agree.
    agreeing: usize,
    /// Differences in a row that are too large, degrees.
    off_deg: Vec<f64>,
    warning: Option<YawWarning>,
    was_inconsistent: bool,
}

impl YawCheck {
    /// Takes in a fix: the yaw that was reported for it and its heading, degrees.
    pub fn fix(&mut self, reported_deg: f64, measured_deg: f64) {
        let off_deg = turn_deg(measured_deg, reported_deg);
        if off_deg.abs() < CONFIRMED_DEG {
            self.agrees();
        } else {
            self.contradicts(off_deg);
        }
    }

    fn agrees(&mut self) {
        self.agreeing += 1;
        // One fix of a wrong place does not make a yaw right that several contradicted.
        if self.warning.is_none() || self.agreeing >= NEEDED {
            self.confirmation = Confirmation::Holds;
            self.off_deg.clear();
            self.warning = None;
        }
    }

    fn contradicts(&mut self, off_deg: f64) {
        self.agreeing = 0;
        if self.warning.is_some() || self.confirmation == Confirmation::Holds {
            return;
        }
        // A yaw of a convention that fixes confirmed can only have been reset: it is off by one angle.
        let is_another = |first_deg: &f64| turn_deg(*first_deg, off_deg).abs() >= CONFIRMED_DEG;
        if self.confirmation == Confirmation::Expired
            && self.off_deg.first().is_some_and(is_another)
        {
            self.off_deg.clear();
        }
        self.off_deg.push(off_deg);
        if self.off_deg.len() >= NEEDED {
            self.warning = Some(YawWarning {
                off_deg: range_deg(&self.off_deg),
            });
            self.was_inconsistent = true;
        }
    }

    /// The whole map was searched so often in a row without a fix.
    pub fn searched_without_fix(&mut self, searches_without_fix: u32) {
        self.confirmation.searched_without_fix(searches_without_fix);
    }

    /// Whether fixes confirmed it before a gap and none since.
    pub fn is_in_doubt(&self) -> bool {
        self.confirmation == Confirmation::Expired
    }

    /// Whether searches are to try other headings than the reported one.
    pub fn is_tested(&self, searches_without_fix: u32) -> bool {
        self.confirmation.is_tested(searches_without_fix)
    }

    /// What is inconsistent, from enough fixes that contradict the reported yaw to as many in a row that agree with it.
    pub fn warning(&self) -> Option<YawWarning> {
        self.warning
    }

    /// Whether it was inconsistent at any time.
    pub fn was_inconsistent(&self) -> bool {
        self.was_inconsistent
    }
}

/// The smallest and the largest of differences around the first, for -180 and 180 are one.
fn range_deg(off_deg: &[f64]) -> [f64; 2] {
    let first_deg = off_deg.first().copied().unwrap_or_default();
    let around = |off_deg: &f64| first_deg + turn_deg(first_deg, *off_deg);
    [f64::min, f64::max].map(|choose| off_deg.iter().map(around).fold(first_deg, choose))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_yaw_that_no_fix_confirms_is_inconsistent_after_four() {
        let mut check = YawCheck::default();
        for measured_deg in [90.0, 100.0, 80.0] {
            check.fix(360.0 - measured_deg, measured_deg);
            assert_eq!(check.warning(), None);
        }
        check.fix(270.0, 90.0);
        let warning = check.warning().unwrap();
        assert_eq!(warning.off_deg, [-200.0, -160.0]);
    }

    #[test]
    fn a_compass_that_is_off_is_consistent_and_so_is_one_that_fixes_confirm() {
        let mut check = YawCheck::default();
        check.fix(355.0, 20.0);
        for _ in 0..9 {
            check.fix(355.0, 120.0);
        }
        assert_eq!(check.warning(), None);
        assert!(!check.is_tested(9));
    }

    #[test]
    fn a_yaw_that_was_reset_in_flight_is_inconsistent_after_four_fixes_that_agree_on_it() {
        let mut check = YawCheck::default();
        check.fix(355.0, 0.0);
        check.searched_without_fix(4);
        assert!(check.is_tested(4));
        // Fixes of wrong places have any heading.
        for measured_deg in [120.0, 250.0, 60.0, 300.0, 180.0] {
            check.fix(0.0, measured_deg);
        }
        assert_eq!(check.warning(), None);
        for measured_deg in [240.0, 250.0, 230.0, 240.0] {
            assert_eq!(check.warning(), None);
            check.fix(0.0, measured_deg);
        }
        assert_eq!(check.warning().unwrap().off_deg, [110.0, 130.0]);
    }

    #[test]
    fn a_yaw_is_used_again_after_four_fixes_in_a_row_that_agree() {
        let mut check = YawCheck::default();
        for _ in 0..4 {
            check.fix(0.0, 90.0);
        }
        for measured_deg in [0.0, 90.0, 5.0, 10.0, 355.0] {
            check.fix(0.0, measured_deg);
            assert!(check.warning().is_some());
        }
        check.fix(0.0, 0.0);
        assert_eq!(check.warning(), None);
        assert!(check.was_inconsistent());
    }
}
