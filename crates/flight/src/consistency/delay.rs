//! Whether the times of the telemetry are those of the photos.
//!
//! In a turn the headings of the fixes and the reported yaw follow the same curve. Where one is behind the other, the clocks differ or the
//! telemetry was stamped when it came and not when it was true.

use std::collections::VecDeque;

use grimnet_geo::turn_deg;
use grimnet_track::Attitude;

use super::median::median;

/// Delays up to this are looked for, seconds.
const MOST_DELAY_S: f64 = 5.0;
/// They are tried in steps of this, seconds.
const STEP_S: f64 = 0.25;
/// So many of the latest fixes in turns are compared.
const FIXES: usize = 12;
/// Compared are fixes around which the yaw turns by this much at least within [`MOST_DELAY_S`] before and after: on a straight leg a
/// delay changes nothing.
const LEAST_TURN_DEG: f64 = 25.0;
/// A fix whose heading fits no delay to this is of another place or of a gust, degrees.
const FITS_DEG: f64 = 8.0;
/// A delay of this and more is inconsistent, seconds.
const LEAST_DELAY_S: f64 = 0.75;
/// The reported times must fit so many times worse than those of the delay.
const WORSE: f64 = 3.0;
/// A yaw further than this from the time asked for says nothing of it, seconds.
const HOLD_S: f64 = 0.6;

/// The times of the telemetry are not those of the photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelayWarning {
    /// By how much the telemetry is late, seconds; early if negative.
    pub delay_s: f64,
}

impl std::fmt::Display for DelayWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let behind = if self.delay_s < 0.0 {
            "before"
        } else {
            "after"
        };
        write!(
            f,
            "the telemetry turns {:.1} s {behind} the photos do: times on the clock of the photos were expected",
            self.delay_s.abs()
        )
    }
}

/// Compares the times of reported yaws with those of fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct DelayCheck {
    /// Times and headings of fixes whose yaws are not all there yet: seconds, degrees.
    waiting: VecDeque<(f64, f64)>,
    /// For each of the latest fixes in turns, the reported yaw minus its heading at each delay, degrees.
    off_deg: VecDeque<Vec<f64>>,
}

impl DelayCheck {
    /// Takes in the heading of a fix, and compares those whose yaws are there by now. `nearest` gives the attitude nearest to a time, and
    /// `newest_s` is the time of the newest.
    pub fn fix<'a>(
        &mut self,
        fix: Option<(f64, f64)>,
        newest_s: f64,
        nearest: impl Fn(f64) -> Option<&'a Attitude>,
    ) {
        self.waiting.extend(fix);
        while let Some(&(time_s, heading_deg)) = self.waiting.front() {
            if newest_s < time_s + MOST_DELAY_S {
                break;
            }
            self.waiting.pop_front();
            let off_deg: Option<Vec<f64>> = delays_s()
                .map(|delay_s| {
                    let reported = nearest(time_s + delay_s)?;
                    let is_near = (reported.time_s - time_s - delay_s).abs() <= HOLD_S;
                    is_near.then(|| turn_deg(heading_deg, reported.top_deg()))
                })
                .collect();
            let Some(off_deg) = off_deg else {
                continue;
            };
            let turned_deg = off_deg
                .windows(2)
                .map(|pair| turn_deg(pair[0], pair[1]))
                .scan(0.0, |turned, step| {
                    *turned += step;
                    Some(*turned)
                })
                .fold([0.0f64; 2], |[least, most], turned| {
                    [least.min(turned), most.max(turned)]
                });
            if turned_deg[1] - turned_deg[0] < LEAST_TURN_DEG {
                continue;
            }
            if self.off_deg.len() == FIXES {
                self.off_deg.pop_front();
            }
            self.off_deg.push_back(off_deg);
        }
    }

    /// What is inconsistent, if the latest fixes in turns agree on it. A compass that is off by the same angle all along is no delay.
    pub fn warning(&self) -> Option<DelayWarning> {
        if self.off_deg.len() < FIXES {
            return None;
        }
        let spread_deg: Vec<f64> = (0..self.off_deg[0].len())
            .map(|delay| self.spread_deg(delay))
            .collect();
        let best =
            (0..spread_deg.len()).min_by(|a, b| spread_deg[*a].total_cmp(&spread_deg[*b]))?;
        let delay_s = delays_s().nth(best)?;
        let as_reported_deg = spread_deg[spread_deg.len() / 2];
        let is_inconsistent = delay_s.abs() >= LEAST_DELAY_S
            && spread_deg[best] <= FITS_DEG
            && as_reported_deg >= WORSE * spread_deg[best].max(1.0);
        is_inconsistent.then_some(DelayWarning { delay_s })
    }

    /// Median distance of the latest fixes' headings from the yaw at one delay, a common angle apart, degrees.
    fn spread_deg(&self, delay: usize) -> f64 {
        let off = || self.off_deg.iter().map(|off| off[delay]);
        // The common angle is around the first, for -180 and 180 are one.
        let first = self.off_deg[0][delay];
        let common = first + median(off().map(|off| turn_deg(first, off)));
        median(off().map(|off| turn_deg(common, off).abs()))
    }
}

/// The delays that are tried, from early to late; the middle one is none.
fn delays_s() -> impl Iterator<Item = f64> {
    let steps = (MOST_DELAY_S / STEP_S) as i32;
    (-steps..=steps).map(|step| f64::from(step) * STEP_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flight of two minutes with a turn every half minute, a fix every second and telemetry ten times a second, which is late.
    fn flown(late_s: f64, compass_deg: f64, alias_every: usize) -> Option<DelayWarning> {
        let heading_deg = |time_s: f64| {
            let (legs, within_s) = ((time_s / 30.0).floor(), time_s.rem_euclid(30.0));
            90.0 * legs + 9.0 * (within_s - 20.0).max(0.0)
        };
        let attitudes: Vec<Attitude> = (0..1300)
            .map(|tick| {
                let time_s = f64::from(tick) * 0.1;
                Attitude {
                    time_s,
                    yaw_deg: (heading_deg(time_s - late_s) + compass_deg).rem_euclid(360.0),
                    pitch_deg: 0.0,
                    roll_deg: 0.0,
                }
            })
            .collect();
        let mut check = DelayCheck::default();
        let mut warning = None;
        for second in 0..120usize {
            let time_s = second as f64;
            let wrong_deg = if second % alias_every == 0 { 70.0 } else { 0.0 };
            let measured_deg =
                (heading_deg(time_s) + wrong_deg + 2.0 * (1.7 * time_s).sin()).rem_euclid(360.0);
            let known = &attitudes[..=10 * second];
            let nearest = |at_s: f64| {
                known
                    .iter()
                    .min_by(|a, b| (a.time_s - at_s).abs().total_cmp(&(b.time_s - at_s).abs()))
            };
            check.fix(Some((time_s, measured_deg)), time_s, nearest);
            warning = warning.or(check.warning());
        }
        warning
    }

    #[test]
    fn telemetry_that_turns_later_or_earlier_is_noticed_and_by_how_much() {
        for (late_s, compass_deg) in [(3.0, 0.0), (1.5, 20.0), (-2.0, -178.0)] {
            let warning = flown(late_s, compass_deg, 7).unwrap();
            assert!(
                (warning.delay_s - late_s).abs() <= 0.25,
                "{late_s}: {warning:?}"
            );
        }
    }

    #[test]
    fn telemetry_in_time_is_consistent_and_so_is_a_compass_that_is_off() {
        for (late_s, compass_deg) in [(0.0, 0.0), (0.2, 0.0), (0.0, 30.0), (0.0, 180.0)] {
            assert_eq!(flown(late_s, compass_deg, 7), None);
        }
    }
}
