//! Whether the fixes that the track does not believe follow a path that the told velocities do not allow.
//!
//! A wrong velocity carries a filter that trusts it away from the right fixes, and it refuses all of them. A place that only looks alike
//! lies at the same offset in photo after photo, so its fixes move as the telemetry says. Fixes that move away from the told velocities,
//! evenly and for some time, contradict them.

use std::collections::VecDeque;

use grimnet_geo::{LonLat, offset_en_m};

/// So many fixes must agree on one path, the latest among them.
const NEEDED: usize = 4;
/// So many of the fixes between the first and the last that agree, as a share.
const SHARE: f64 = 0.75;
/// They must be of so long a time at least, seconds: a gust tilts the camera and moves the image centre for a moment.
const LEAST_TIME_S: f64 = 2.5;
/// Fixes are kept for so long, seconds.
const LONGEST_S: f64 = 10.0;
/// Fixes are on the path up to this distance, metres: their own error, and a camera that moves by one or two degrees.
const ON_PATH_M: f64 = 4.0;
/// So far they must move, and so far away from what was told and from the track, metres. Fixes that stay where they are may be of a
/// camera whose picture stands still.
const LEAST_MOVED_M: f64 = 12.0;
/// No small drone is faster, metres per second.
const MOST_SPEED_M_S: f64 = 60.0;
/// The told velocity must be off by more than so many of its standard deviations.
const SIGMAS: f64 = 3.0;

/// A fix that the track does not believe yet.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unbelieved {
    /// Seconds.
    pub time_s: f64,
    /// Where it is.
    pub place: LonLat,
    /// Where the track is at its time, if that may be used.
    pub track: Option<LonLat>,
    /// What the told velocities add up to, metres east and north of any place.
    pub told_en_m: [f64; 2],
}

/// How far an aircraft moved, metres east and north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moved {
    /// By the told velocities.
    pub told_en_m: [f64; 2],
    /// By the fixes.
    pub seen_en_m: [f64; 2],
}

/// The latest fixes in a row that the track did not believe.
#[derive(Debug, Clone, Default)]
pub(crate) struct UnbelievedFixes {
    fixes: VecDeque<Unbelieved>,
}

impl UnbelievedFixes {
    /// Adds the latest fix.
    pub fn add(&mut self, fix: Unbelieved) {
        self.fixes
            .retain(|other| (0.0..=LONGEST_S).contains(&(fix.time_s - other.time_s)));
        self.fixes.push_back(fix);
    }

    /// Forgets all: the track believed one, or it is not known what was told in between.
    pub fn clear(&mut self) {
        self.fixes.clear();
    }

    /// How far the fixes and the told velocities moved, if the latest fixes agree on a path that velocities with this error do not
    /// allow.
    pub fn contradiction(&self, told_sigma_m_s: f64) -> Option<Moved> {
        let last = self.fixes.back()?;
        let from_last = |place| {
            let (east_m, north_m) = offset_en_m(last.place, place);
            [east_m, north_m]
        };
        let seen_en_m: Vec<[f64; 2]> = self.fixes.iter().map(|fix| from_last(fix.place)).collect();
        let path = |first: usize| {
            let (from, from_en_m) = (self.fixes.get(first)?, seen_en_m.get(first)?);
            let interval_s = last.time_s - from.time_s;
            let seen = difference([0.0; 2], *from_en_m);
            let told = difference(last.told_en_m, from.told_en_m);
            let drift = difference(seen, told);
            let from_track_m = from.track.zip(last.track).map(|(before, now)| {
                length(difference(
                    seen,
                    difference(from_last(now), from_last(before)),
                ))
            });
            let is_told_wrong = interval_s >= LEAST_TIME_S
                && length(drift) > (SIGMAS * told_sigma_m_s * interval_s).max(LEAST_MOVED_M)
                && from_track_m.is_none_or(|moved_m| moved_m > LEAST_MOVED_M)
                && (LEAST_MOVED_M..MOST_SPEED_M_S * interval_s).contains(&length(seen));
            if !is_told_wrong {
                return None;
            }
            let between = || self.fixes.iter().zip(&seen_en_m).skip(first);
            let on_path = between().filter(|(fix, en_m)| {
                let share = (fix.time_s - from.time_s) / interval_s;
                let drifted = difference(
                    difference(**en_m, *from_en_m),
                    difference(fix.told_en_m, from.told_en_m),
                );
                length(difference(drifted, drift.map(|whole| share * whole))) <= ON_PATH_M
            });
            let count = on_path.count();
            (count >= NEEDED && count as f64 >= SHARE * between().count() as f64).then_some(Moved {
                told_en_m: told,
                seen_en_m: seen,
            })
        };
        (0..self.fixes.len()).find_map(path)
    }
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn length([east, north]: [f64; 2]) -> f64 {
    east.hypot(north)
}

#[cfg(test)]
mod tests {
    use grimnet_geo::destination_en_m;

    use super::*;

    const HERE: LonLat = LonLat::new(1.5, 1.0);
    const TOLD_SIGMA_M_S: f64 = 0.5;

    /// A flight to the east, told at 10 m/s, with a fix every `interval_s`, seen where `seen_en_m` says for number and time.
    /// The track follows what is told. Gives the number of fixes until they contradict.
    fn flown(interval_s: f64, seen_en_m: impl Fn(usize, f64) -> [f64; 2]) -> Option<usize> {
        let mut fixes = UnbelievedFixes::default();
        (0..60).find(|number| {
            let time_s = *number as f64 * interval_s;
            let [east_m, north_m] = seen_en_m(*number, time_s);
            // Fixes scatter.
            let scatter_m = [0.0, 1.5, -1.0, 0.5, -1.5][number % 5];
            fixes.add(Unbelieved {
                time_s,
                place: destination_en_m(HERE, east_m + scatter_m, north_m - scatter_m),
                track: Some(destination_en_m(HERE, 10.0 * time_s, 0.0)),
                told_en_m: [10.0 * time_s, 0.0],
            });
            fixes.contradiction(TOLD_SIGMA_M_S).is_some()
        })
    }

    #[test]
    fn fixes_that_move_evenly_away_from_what_is_told_contradict_it() {
        for (interval_s, cross_m_s) in [(1.0, 3.0), (1.0, 5.0), (0.2, 5.0)] {
            let number = flown(interval_s, |_, s| [10.0 * s, cross_m_s * s]).unwrap();
            let drifted_m = cross_m_s * interval_s * number as f64;
            assert!(
                number >= NEEDED - 1 && drifted_m < 20.0,
                "{number}: {drifted_m} m"
            );
        }
        // Every sixth is of another place.
        let alias = |number: usize| if number % 6 == 2 { 200.0 } else { 0.0 };
        assert!(flown(1.0, |number, s| [10.0 * s, 5.0 * s + alias(number)]).is_some());
        assert!(
            flown(1.0, |_, s| [20.0 * s, 0.0]).is_some(),
            "another unit of the velocity"
        );
    }

    #[test]
    fn what_a_wrong_place_shows_contradicts_nothing() {
        let offset = |_, s: f64| [10.0 * s + 80.0, 60.0];
        assert_eq!(flown(1.0, offset), None, "a place that looks alike");
        let two_places = |number: usize, s: f64| [10.0 * s, if number < 9 { 60.0 } else { -90.0 }];
        assert_eq!(flown(1.0, two_places), None);
        // Places anywhere within a window of 120 m.
        for flight in 0..20u64 {
            let anywhere = |number: usize, s: f64| {
                let mut bits = (flight << 32 | number as u64) + 1;
                let mut within_window_m = || {
                    // Marsaglia, "Xorshift RNGs" (2003).
                    for _ in 0..4 {
                        bits ^= bits << 13;
                        bits ^= bits >> 7;
                        bits ^= bits << 17;
                    }
                    (bits % 1200) as f64 / 10.0 - 60.0
                };
                [10.0 * s + within_window_m(), within_window_m()]
            };
            assert_eq!(flown(1.0, anywhere), None, "flight {flight}");
        }
        assert_eq!(
            flown(1.0, |_, _| [0.0; 2]),
            None,
            "a picture that stands still"
        );
        let within_sigma = |_, s: f64| [10.8 * s, 0.0];
        assert_eq!(flown(1.0, within_sigma), None);
    }

    #[test]
    fn fixes_that_move_as_the_track_does_do_not_contradict_what_is_told() {
        // The track knows that the velocities are off, and the fixes are of a place that looks alike.
        let mut fixes = UnbelievedFixes::default();
        for number in 0..30 {
            let time_s = f64::from(number);
            fixes.add(Unbelieved {
                time_s,
                place: destination_en_m(HERE, 12.0 * time_s, 90.0),
                track: Some(destination_en_m(HERE, 12.0 * time_s, 0.0)),
                told_en_m: [10.0 * time_s, 0.0],
            });
            assert_eq!(fixes.contradiction(TOLD_SIGMA_M_S), None);
        }
    }
}
