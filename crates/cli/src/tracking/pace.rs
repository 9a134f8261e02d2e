//! How often frames come, and with it how long the last fix is a recent one.

use std::collections::VecDeque;

/// Steps between frames that are kept.
const KEPT: usize = 5;
/// The next fix may be so many steps away: a frame that comes late is no interruption, one without a fix is.
const STEPS: f64 = 1.5;
/// However seldom frames come, a fix is not recent for longer, seconds.
const MOST_S: f64 = 10.0;

/// See the module.
#[derive(Debug, Default)]
pub struct Pace {
    last_s: Option<f64>,
    /// The newest one last, seconds.
    steps_s: VecDeque<f64>,
}

impl Pace {
    /// Takes in that a frame was exposed at `time_s`.
    pub fn frame(&mut self, time_s: f64) {
        if let Some(last_s) = self.last_s.replace(time_s)
            && time_s > last_s
        {
            if self.steps_s.len() == KEPT {
                self.steps_s.pop_front();
            }
            self.steps_s.push_back(time_s - last_s);
        }
    }

    /// When the last frame was exposed, seconds.
    pub fn last_s(&self) -> Option<f64> {
        self.last_s
    }

    /// The second longest of the last steps, so that one pause is none, seconds. 0 before there are two.
    fn step_s(&self) -> f64 {
        let mut steps_s = Vec::from_iter(self.steps_s.iter().copied());
        steps_s.sort_by(f64::total_cmp);
        steps_s.into_iter().rev().nth(1).unwrap_or(0.0)
    }

    /// For how long after its exposure the last frame's fix is a recent one, seconds: until the next one is overdue, whose fix is
    /// `age_s` old as well when it is known, and no shorter than `least_s`.
    pub fn fix_is_recent_for_s(&self, age_s: f64, least_s: f64) -> f64 {
        let expected_s = age_s.max(0.0) + STEPS * self.step_s();
        expected_s.min(MOST_S).max(least_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recent_for_s(times_s: &[f64], age_s: f64) -> f64 {
        let mut pace = Pace::default();
        times_s.iter().for_each(|time_s| pace.frame(*time_s));
        pace.fix_is_recent_for_s(age_s, 2.0)
    }

    #[test]
    fn a_fix_is_recent_until_the_next_one_is_overdue() {
        for (times_s, age_s, expected_s) in [
            // Nothing is known, or frames come often: as the filter has it.
            (&[][..], 0.3, 2.0),
            (&[0.0, 1.0, 2.0, 3.0], 0.3, 2.0),
            // They come late, or seldom.
            (&[0.0, 1.0, 2.0, 3.0], 2.1, 3.6),
            (&[0.0, 4.0, 8.0, 12.0], 0.5, 6.5),
            (&[0.0, 60.0, 120.0], 0.5, 10.0),
            // A pause, a frame that comes again.
            (&[0.0, 1.0, 2.0, 62.0, 63.0], 0.3, 2.0),
            (&[0.0, 4.0, 4.0, 8.0], 0.0, 6.0),
        ] {
            let found_s = recent_for_s(times_s, age_s);
            assert!(
                (found_s - expected_s).abs() < 1e-9,
                "{times_s:?}: {found_s}"
            );
        }
    }
}
