//! Whether fixes move as the reported velocities say: an innovation test of the displacement over some seconds.
//!
//! A wrong velocity carries a filter that trusts it away from the right fixes. If it is slow, the filter accepts them and lags behind;
//! else it rejects all of them. A place that only looks alike lies at the same offset in photo after photo, so its fixes move as the
//! telemetry says. Fixes that move away from the reported velocities, evenly and for some time, contradict them.

use std::collections::VecDeque;

use grimnet_geo::offset_en_m;

use super::agreement::Leg;
use super::compared_fix::{ComparedFix, MotionSum, PlacedFix};
use super::fix_path::{FixPath, InPlane, Moved};
use super::plane_vector::difference;

/// Fixes are kept for so long, seconds.
const LONGEST_S: f64 = 20.0;

/// The latest fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct DisplacementTest {
    fixes: VecDeque<ComparedFix>,
    /// The motions up to the latest frame, and its time in seconds.
    motions: Option<(f64, MotionSum)>,
}

impl DisplacementTest {
    /// Adds the latest fix, and what the reported velocities add up to by its time, metres east and north of any place.
    pub fn add(&mut self, fix: PlacedFix, reported_en_m: [f64; 2]) {
        self.fixes.retain(|ComparedFix { fix: other, .. }| {
            let since_s = fix.time_s - other.time_s;
            (0.0..=LONGEST_S).contains(&since_s) && other.is_of_aircraft == fix.is_of_aircraft
        });
        self.fixes.push_back(ComparedFix {
            fix,
            reported_en_m,
            motions: None,
            is_accepted: false,
        });
    }

    /// The track accepted the latest fix.
    pub fn accepted(&mut self) {
        if let Some(latest) = self.fixes.back_mut() {
            latest.is_accepted = true;
        }
    }

    /// Takes in the motion between two frames over ground, metres towards the top and the right of the photo, after the fix of the
    /// second one. `None`: there is none, or it says nothing, as that of a picture that is the same again.
    pub fn add_motion(&mut self, [from_s, to_s]: [f64; 2], moved_m: Option<[f64; 2]>) {
        let before = self.motions.filter(|(time_s, _)| *time_s == from_s);
        let start = MotionSum {
            from_s,
            moved_m: [0.0; 2],
        };
        self.motions = moved_m.map(|[forward_m, right_m]| {
            let sum = before.map_or(start, |(_, sum)| sum);
            let moved_m = [sum.moved_m[0] + forward_m, sum.moved_m[1] + right_m];
            (to_s, MotionSum { moved_m, ..sum })
        });
        for ComparedFix { fix, motions, .. } in &mut self.fixes {
            if fix.time_s == to_s {
                *motions = self.motions.map(|(_, sum)| sum);
            } else if fix.time_s == from_s && before.is_none() && moved_m.is_some() {
                *motions = Some(start);
            }
        }
    }

    /// Forgets all: it is not known what was reported in between.
    pub fn clear(&mut self) {
        self.fixes.clear();
    }

    /// How far the fixes and the reported velocities moved, if the latest fixes agree on a path that velocities with this error do not
    /// allow.
    pub fn inconsistency(&self, reported_sigma_m_s: f64) -> Option<Moved> {
        let origin = self.fixes.back()?.fix.place;
        let fixes: Vec<InPlane> = self
            .fixes
            .iter()
            .map(|compared| InPlane::new(compared, origin))
            .collect();
        (0..fixes.len())
            .filter_map(|first| FixPath::new(&fixes[first..]))
            .find(|path| path.contradicts(reported_sigma_m_s))
            .map(|path| path.moved())
    }

    /// The way between the first and the latest of the fixes that the track accepted, if it accepted the latest.
    pub fn accepted_leg(&self) -> Option<Leg> {
        let to = self.fixes.back().filter(|latest| latest.is_accepted)?;
        let from = self.fixes.iter().find(|fix| fix.is_accepted)?;
        Some(Leg {
            time_s: to.fix.time_s,
            interval_s: to.fix.time_s - from.fix.time_s,
            measured_en_m: offset_en_m(from.fix.place, to.fix.place).into(),
            reported_en_m: difference(to.reported_en_m, from.reported_en_m),
            is_of_aircraft: to.fix.is_of_aircraft,
        })
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::{LonLat, destination_en_m};

    use super::*;
    use crate::consistency::fix_path::NEEDED;

    const HERE: LonLat = LonLat::new(1.5, 1.0);
    const REPORTED_SIGMA_M_S: f64 = 0.5;

    /// Fixes scatter, metres.
    fn scatter_m(number: usize) -> f64 {
        [0.0, 1.5, -1.0, 0.5, -1.5][number % 5]
    }

    /// A flight to the east, reported at 10 m/s, with a fix every `interval_s`, seen where `measured_en_m` says for number and time.
    /// The track follows what is reported. Gives the number of fixes until they contradict.
    fn flown(interval_s: f64, measured_en_m: impl Fn(usize, f64) -> [f64; 2]) -> Option<usize> {
        let mut test = DisplacementTest::default();
        (0..60).find(|number| {
            let time_s = *number as f64 * interval_s;
            let [east_m, north_m] = measured_en_m(*number, time_s);
            let off_m = scatter_m(*number);
            let fix = PlacedFix {
                time_s,
                place: destination_en_m(HERE, east_m + off_m, north_m - off_m),
                is_of_aircraft: true,
                track: Some(destination_en_m(HERE, 10.0 * time_s, 0.0)),
            };
            test.add(fix, [10.0 * time_s, 0.0]);
            test.inconsistency(REPORTED_SIGMA_M_S).is_some()
        })
    }

    #[test]
    fn fixes_that_move_evenly_away_from_what_is_reported_contradict_it() {
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
            "nothing says that the camera stands still"
        );
        let within_sigma = |_, s: f64| [10.8 * s, 0.0];
        assert_eq!(flown(1.0, within_sigma), None);
    }

    /// Fixes twice a second that the track accepts, reported at `reported_m_s` to the east, that move at `measured_m_s`, with the
    /// motion between frames of a speed or none.
    fn accepted(
        measured_m_s: f64,
        reported_m_s: f64,
        motion_m_s: Option<f64>,
        is_of_aircraft: bool,
    ) -> Option<Moved> {
        let mut test = DisplacementTest::default();
        (0..40).find_map(|number| {
            let time_s = 0.5 * number as f64;
            let off_m = 0.5 * scatter_m(number);
            let place = destination_en_m(HERE, measured_m_s * time_s + off_m, -off_m);
            let fix = PlacedFix {
                time_s,
                place,
                is_of_aircraft,
                track: Some(place),
            };
            test.add(fix, [reported_m_s * time_s, 0.0]);
            let moved_m = motion_m_s.map(|speed_m_s| [0.5 * speed_m_s, 0.0]);
            test.add_motion([time_s - 0.5, time_s], moved_m);
            let inconsistency = test.inconsistency(REPORTED_SIGMA_M_S);
            test.accepted();
            inconsistency
        })
    }

    #[test]
    fn fixes_that_the_track_accepts_contradict_what_is_far_off() {
        let moved = accepted(10.0, 15.0, None, true).unwrap();
        assert!(moved.measured_en_m.is_some_and(|[east_m, _]| east_m > 35.0));
        assert_eq!(accepted(10.0, 15.0, None, false), None, "of unknown tilt");
        assert_eq!(accepted(10.0, 12.0, None, true), None, "the track knows");
    }

    #[test]
    fn standing_still_contradicts_velocities_if_the_motion_between_frames_says_so() {
        for is_of_aircraft in [false, true] {
            let moved = accepted(0.0, 5.0, Some(0.2), is_of_aircraft).unwrap();
            assert_eq!(moved.measured_en_m, None);
            assert_eq!(accepted(0.0, 5.0, None, is_of_aircraft), None);
            assert_eq!(accepted(0.0, 5.0, Some(5.0), is_of_aircraft), None);
            assert_eq!(accepted(0.0, 1.0, Some(0.0), is_of_aircraft), None);
        }
    }

    #[test]
    fn fixes_that_move_as_the_track_does_do_not_contradict_what_is_reported() {
        // The track knows that the velocities are off, and the fixes are of a place that looks alike.
        let mut test = DisplacementTest::default();
        for number in 0..30 {
            let time_s = f64::from(number);
            let fix = PlacedFix {
                time_s,
                place: destination_en_m(HERE, 12.0 * time_s, 90.0),
                is_of_aircraft: true,
                track: Some(destination_en_m(HERE, 12.0 * time_s, 0.0)),
            };
            test.add(fix, [10.0 * time_s, 0.0]);
            assert_eq!(test.inconsistency(REPORTED_SIGMA_M_S), None);
        }
    }
}
