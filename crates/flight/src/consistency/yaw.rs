//! Whether the yaw of the telemetry is the heading that fixes show.
//!
//! A yaw of another convention (counter-clockwise, in radians, of the tail) makes every search look under a wrong heading, so that none
//! gives a fix. Where the whole map was searched in vain under a yaw that no fix has confirmed yet, it is searched under every heading as
//! well, and the fixes of that tell.

use grimnet_geo::turn_deg;

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
        let [least, most] = self.off_deg;
        write!(
            f,
            "the yaw of the telemetry is {least:.0} to {most:.0} degrees off the headings of the fixes: degrees clockwise from true \
             north were expected"
        )
    }
}

/// Compares the reported yaw with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct YawCheck {
    is_confirmed: bool,
    /// Differences that are too large, degrees.
    off_deg: Vec<f64>,
}

impl YawCheck {
    /// Takes in a fix: the yaw that was reported for it and its heading, degrees.
    pub fn fix(&mut self, reported_deg: f64, measured_deg: f64) {
        let off_deg = turn_deg(measured_deg, reported_deg);
        if off_deg.abs() < CONFIRMED_DEG {
            self.is_confirmed = true;
        } else if self.off_deg.len() < NEEDED {
            self.off_deg.push(off_deg);
        }
    }

    /// Whether a fix has ever confirmed it.
    pub fn is_confirmed(&self) -> bool {
        self.is_confirmed
    }

    /// What is inconsistent, if enough fixes contradict the reported yaw and none ever confirmed it.
    pub fn warning(&self) -> Option<YawWarning> {
        let is_inconsistent = !self.is_confirmed && self.off_deg.len() >= NEEDED;
        let first_deg = *self.off_deg.first().filter(|_| is_inconsistent)?;
        // Around the first, for -180 and 180 are one.
        let around = |off_deg: &f64| first_deg + turn_deg(first_deg, *off_deg);
        let [least, most] = [f64::min, f64::max]
            .map(|choose| self.off_deg.iter().map(around).fold(first_deg, choose));
        Some(YawWarning {
            off_deg: [least, most],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_yaw_that_no_fix_confirms_is_inconsistent_after_four() {
        let mut check = YawCheck::default();
        assert!(!check.is_confirmed());
        for measured_deg in [90.0, 100.0, 80.0] {
            check.fix(360.0 - measured_deg, measured_deg);
            assert_eq!(check.warning(), None);
        }
        check.fix(270.0, 90.0);
        let warning = check.warning().unwrap();
        assert_eq!(warning.off_deg, [-200.0, -160.0]);
    }

    #[test]
    fn a_compass_that_is_off_is_consistent_and_so_is_one_that_was_ever_right() {
        let mut check = YawCheck::default();
        check.fix(355.0, 20.0);
        for _ in 0..9 {
            check.fix(355.0, 120.0);
        }
        assert_eq!(check.warning(), None);
        assert!(check.is_confirmed());
    }
}
