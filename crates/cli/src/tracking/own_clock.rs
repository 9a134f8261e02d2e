//! How a clock of the frames' own stands to the one of the links, judged by when the frames come.

use std::collections::VecDeque;

/// Frames are compared over the span that is going on and the one before it, seconds each. A clock that is wrong by a thousandth is
/// off by no more than 0.03 s then.
const SPAN_S: f64 = 15.0;
/// Spans that are kept, to say how fast the clock goes.
const KEPT: usize = 6;

/// See the module.
///
/// A frame comes after its exposure, never before: each one says that its clock is ahead of the links' by so much at least, and the
/// one that came earliest after its exposure says it best. It is forgotten after a while, so that clocks may drift apart.
#[derive(Debug, Default)]
pub struct OwnClock {
    /// The newest one last.
    spans: VecDeque<Span>,
}

#[derive(Debug, Clone, Copy)]
struct Span {
    /// On the links' clock, seconds.
    began_s: f64,
    /// When the frame came that says most, on the links' clock, seconds.
    came_s: f64,
    /// By how much its clock is ahead of the links', seconds.
    ahead_s: f64,
}

impl OwnClock {
    /// Takes in a frame that came at `came_s` on the links' clock, when its own clock was ahead by `ahead_s` or more. Gives by how much
    /// it is ahead, seconds.
    pub fn take(&mut self, came_s: f64, ahead_s: f64) -> f64 {
        match self.spans.back_mut() {
            Some(span) if came_s - span.began_s <= SPAN_S => {
                if ahead_s > span.ahead_s {
                    *span = Span {
                        came_s,
                        ahead_s,
                        ..*span
                    };
                }
            }
            _ => {
                if self.spans.len() == KEPT {
                    self.spans.pop_front();
                }
                self.spans.push_back(Span {
                    began_s: came_s,
                    came_s,
                    ahead_s,
                });
            }
        }
        let recent = self.spans.iter().rev().take(2);
        recent.fold(ahead_s, |most_s, span| most_s.max(span.ahead_s))
    }

    /// How many seconds this clock gains in a second, by the last spans that are over; negative where it goes slow. A step, such as a
    /// pause of a camera whose frames are counted, is no gain: what both of the last two intervals say counts. `None` before there are
    /// two.
    pub fn gain(&self) -> Option<f64> {
        let mut over = self.spans.iter().rev().skip(1);
        let (last, middle, first) = (over.next()?, over.next()?, over.next()?);
        let (before, after) = (middle.gain_since(first), last.gain_since(middle));
        Some(if before * after <= 0.0 {
            0.0
        } else if before.abs() < after.abs() {
            before
        } else {
            after
        })
    }

    /// As [`OwnClock::gain`], but over all spans since the last step, so that a small one is told. `step_gain` is a gain that is none.
    /// `None` if these are not `over_s` apart.
    pub fn gain_since_step(&self, step_gain: f64, over_s: f64) -> Option<f64> {
        let mut over = self.spans.iter().rev().skip(1);
        let last = over.next()?;
        let mut first = last;
        for earlier in over {
            if first.gain_since(earlier).abs() > step_gain {
                break;
            }
            first = earlier;
        }
        let between_s = last.came_s - first.came_s;
        (between_s >= over_s).then(|| (last.ahead_s - first.ahead_s) / between_s)
    }
}

impl Span {
    /// Seconds gained in a second. Frames may be late, so that two that came soon after each other tell no rate.
    fn gain_since(&self, earlier: &Self) -> f64 {
        (self.ahead_s - earlier.ahead_s) / (self.came_s - earlier.came_s).max(SPAN_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame a second by a clock that goes `speed` times as fast as the links', late by up to 0.4 s, but every fifth one at once.
    /// Gives by how much the clock was taken to be ahead when it was ahead by how much, at each frame.
    fn taken(clock: &mut OwnClock, speed: f64, frames: u32) -> Vec<(f64, f64)> {
        let late_s = |number: u32| 0.1 * f64::from(number % 5);
        (0..frames)
            .map(|number| {
                let exposed_s = f64::from(number) / speed;
                let came_s = exposed_s + late_s(number);
                let ahead_s = clock.take(came_s, f64::from(number) - came_s);
                (ahead_s, f64::from(number) - exposed_s)
            })
            .collect()
    }

    #[test]
    fn a_clock_that_drifts_is_followed() {
        for speed in [0.98, 0.999, 1.0, 1.001, 1.02] {
            let mut clock = OwnClock::default();
            for (ahead_s, true_ahead_s) in taken(&mut clock, speed, 600) {
                let off_s = ahead_s - true_ahead_s;
                let most_s = 2.0 * SPAN_S * (speed - 1.0f64).abs() + 1e-9;
                assert!(off_s.abs() <= most_s.max(0.1), "{speed}: {off_s}");
            }
            let gain = clock.gain_since_step(0.1, 45.0).unwrap();
            assert!((gain - (speed - 1.0)).abs() < 0.003, "{speed}: {gain}");
            let gain = clock.gain().unwrap();
            assert!((gain - (speed - 1.0)).abs() < 0.03, "{speed}: {gain}");
        }
    }

    /// A camera whose frames are counted, and that gives none for a while or several at once.
    #[test]
    fn a_step_is_no_gain() {
        for step_s in [-30.0, -5.0, 5.0] {
            let mut clock = OwnClock::default();
            for second in 0..150 {
                let ahead_s = if second < 60 { 0.0 } else { step_s };
                clock.take(f64::from(second), ahead_s);
                for gain in [clock.gain(), clock.gain_since_step(0.1, 45.0)] {
                    assert!(
                        gain.unwrap_or(0.0).abs() < 1e-9,
                        "{step_s} s, {second}: {gain:?}"
                    );
                }
            }
            assert!(clock.gain_since_step(0.1, 45.0).is_some());
        }
    }

    #[test]
    fn how_fast_it_goes_is_not_told_by_a_few_frames() {
        let mut clock = OwnClock::default();
        taken(&mut clock, 1.0, 16);
        assert_eq!(
            (clock.gain(), clock.gain_since_step(0.1, 0.1)),
            (None, None)
        );
        assert_eq!(OwnClock::default().gain_since_step(0.1, 0.0), None);
    }
}
