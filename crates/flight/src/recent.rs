//! The latest telemetry, to steer the search of a frame before the track knows more.

use std::collections::VecDeque;

use grimnet_track::{Attitude, Height, Input};

/// So many attitudes are kept: [`KEPT_S`] of 1 kHz.
const MOST_ATTITUDES: usize = 40_000;
/// Older ones than this are of no frame that the filter takes, seconds.
const KEPT_S: f64 = 40.0;

/// See the module.
#[derive(Debug, Clone, Default)]
pub(crate) struct Recent {
    attitudes: VecDeque<Attitude>,
    height: Option<Height>,
}

impl Recent {
    /// Keeps attitudes and heights.
    pub fn take(&mut self, input: &Input) {
        match input {
            Input::Attitude(attitude) => {
                if self.attitudes.len() == MOST_ATTITUDES {
                    self.attitudes.pop_front();
                }
                let is_old = |other: &Attitude| other.time_s < attitude.time_s - KEPT_S;
                while self.attitudes.front().is_some_and(is_old) {
                    self.attitudes.pop_front();
                }
                self.attitudes.push_back(*attitude);
            }
            Input::Height(height) => self.height = Some(*height),
            _ => {}
        }
    }

    /// The attitude nearest to a time, if it says something of that.
    pub fn attitude_at(&self, time_s: f64) -> Option<Attitude> {
        self.nearest(time_s)
            .filter(|attitude| (attitude.time_s - time_s).abs() <= Attitude::HOLD_S)
            .copied()
    }

    /// The attitude nearest to a time, however far away.
    pub fn nearest(&self, time_s: f64) -> Option<&Attitude> {
        let away_s = |attitude: &&Attitude| (attitude.time_s - time_s).abs();
        self.attitudes
            .iter()
            .min_by(|a, b| away_s(a).total_cmp(&away_s(b)))
    }

    /// The latest time of an attitude, seconds.
    pub fn newest_attitude_s(&self) -> Option<f64> {
        self.attitudes
            .iter()
            .map(|attitude| attitude.time_s)
            .reduce(f64::max)
    }

    /// The latest height above ground, metres, if it is of about this time.
    pub fn height_agl_m_at(&self, time_s: f64) -> Option<f64> {
        self.height
            .filter(|height| (height.time_s - time_s).abs() <= Height::HOLD_S)
            .map(|height| height.agl_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attitude(time_s: f64) -> Input {
        Input::Attitude(Attitude {
            time_s,
            yaw_deg: time_s,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        })
    }

    #[test]
    fn the_nearest_attitude_in_any_order_and_none_too_far_away() {
        let mut recent = Recent::default();
        for time_s in [1.0, 1.4, 1.2, 9.0] {
            recent.take(&attitude(time_s));
        }
        assert_eq!(recent.attitude_at(1.25).unwrap().time_s, 1.2);
        assert_eq!(recent.attitude_at(8.6).unwrap().time_s, 9.0);
        assert!(recent.attitude_at(5.0).is_none());
        assert!(recent.attitude_at(f64::NAN).is_none());
    }

    #[test]
    fn attitudes_that_come_a_thousand_times_a_second_are_kept_as_long() {
        let mut recent = Recent::default();
        for number in 0..30_000 {
            recent.take(&attitude(1e-3 * f64::from(number)));
        }
        assert!((recent.attitude_at(1.0).unwrap().time_s - 1.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let mut recent = Recent::default();
        for number in 0..2 * MOST_ATTITUDES {
            recent.take(&attitude(5e-4 * number as f64));
        }
        assert_eq!(recent.attitudes.len(), MOST_ATTITUDES);
        recent.take(&attitude(90.0));
        assert_eq!(recent.attitudes.len(), 1, "the others are too old");
    }
}
