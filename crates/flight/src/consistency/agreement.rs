//! Whether velocities that fixes contradicted agree with them again.
//!
//! Velocities may be wrong for a while: those of an autopilot that lost its satellites, or was deceived. They are used again once they
//! agree for long enough with the fixes that the track accepts without them. A velocity that stands at one value agrees with an aircraft
//! that hovers or flies straight on, so the fixes must have moved as no single velocity allows. Each time that velocities are left out
//! again they have to agree for twice as long: what deceives them now and then moves the track for an ever smaller share of the time.

use super::plane_vector::{difference, length};

/// Fixes closer to each other in time say little, seconds.
const LEAST_LEG_S: f64 = 10.0;
/// Velocities agree with fixes that moved as they say within so many of their standard deviations,
const SIGMAS: f64 = 2.0;
/// and so much besides, metres: in a banked turn a fix and the attitude place the aircraft to about ten metres;
const OFF_M: f64 = 12.0;
/// or so much where the attitude is unknown, metres: the tilt of a turn moves the image centre.
const OFF_OF_CENTRE_M: f64 = 40.0;
/// So many fixes in a row must agree,
const NEEDED: usize = 20;
/// for so long, seconds, after velocities were left out for the first time.
const NEEDED_S: f64 = 60.0;
/// With a longer time between two of them the row begins again, seconds.
const LONGEST_GAP_S: f64 = 20.0;

/// The way between two fixes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Leg {
    /// When it ended, seconds.
    pub time_s: f64,
    /// How long it took, seconds.
    pub interval_s: f64,
    /// How far the fixes moved, metres east and north.
    pub measured_en_m: [f64; 2],
    /// How far the velocities say.
    pub reported_en_m: [f64; 2],
    /// Whether the fixes are of the aircraft and not of the image centre.
    pub is_of_aircraft: bool,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Agreement {
    /// How often velocities were left out.
    times_left_out: i32,
    row: Option<Row>,
}

/// Legs in a row that agree.
#[derive(Debug, Clone, Copy)]
struct Row {
    from_s: f64,
    to_s: f64,
    legs: usize,
    /// The least and the largest single velocity that agrees with all of them as well, east and north, metres per second.
    single_m_s: [[f64; 2]; 2],
}

impl Agreement {
    /// Velocities are left out from now on.
    pub fn leave_out(&mut self) {
        self.times_left_out += 1;
        self.row = None;
    }

    /// Fixes contradict the velocities, or it is not known what was reported: the row ends.
    pub fn end_row(&mut self) {
        self.row = None;
    }

    /// Takes in the way to a fix that the track accepts, and the error of the velocities. Gives whether they are to be used again.
    pub fn take(&mut self, leg: &Leg, sigma_m_s: f64) -> bool {
        if leg.interval_s < LEAST_LEG_S {
            return false;
        }
        let besides_m = if leg.is_of_aircraft {
            OFF_M
        } else {
            OFF_OF_CENTRE_M
        };
        let allowed_m = (SIGMAS * sigma_m_s * leg.interval_s).hypot(besides_m);
        if length(difference(leg.measured_en_m, leg.reported_en_m)) > allowed_m {
            self.row = None;
            return false;
        }
        let before = self
            .row
            .filter(|row| (0.0..=LONGEST_GAP_S).contains(&(leg.time_s - row.to_s)));
        let mut row = before.unwrap_or(Row {
            from_s: leg.time_s,
            to_s: leg.time_s,
            legs: 0,
            single_m_s: [[f64::NEG_INFINITY, f64::INFINITY]; 2],
        });
        row.to_s = leg.time_s;
        row.legs += 1;
        for ([least, most], moved_m) in row.single_m_s.iter_mut().zip(leg.measured_en_m) {
            *least = least.max((moved_m - allowed_m) / leg.interval_s);
            *most = most.min((moved_m + allowed_m) / leg.interval_s);
        }
        self.row = Some(row);
        let needed_s = NEEDED_S * 2f64.powi(self.times_left_out - 1);
        row.legs >= NEEDED
            && row.to_s - row.from_s >= needed_s
            && row.single_m_s.iter().any(|[least, most]| least > most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Legs of ten seconds, one a second, of a flight whose velocity to the east is as given, while that plus an error is reported. Gives
    /// the seconds until velocities are used again.
    fn used_again_s(
        agreement: &mut Agreement,
        is_of_aircraft: bool,
        true_m_s: impl Fn(usize) -> f64,
        error_m_s: impl Fn(usize) -> f64,
    ) -> Option<usize> {
        (0..1000).find(|second| {
            let leg = Leg {
                time_s: *second as f64,
                interval_s: 10.0,
                measured_en_m: [10.0 * true_m_s(*second), 0.0],
                reported_en_m: [10.0 * (true_m_s(*second) + error_m_s(*second)), 0.0],
                is_of_aircraft,
            };
            agreement.take(&leg, 0.3)
        })
    }

    /// There and back, 30 s each.
    fn there_and_back_m_s(second: usize) -> f64 {
        if (second / 30).is_multiple_of(2) {
            8.0
        } else {
            -8.0
        }
    }

    #[test]
    fn velocities_that_agree_are_used_again_each_time_later() {
        let mut agreement = Agreement::default();
        for needed_s in [60, 120, 240] {
            agreement.leave_out();
            let after_s = used_again_s(&mut agreement, true, there_and_back_m_s, |_| 0.3);
            assert_eq!(after_s, Some(needed_s));
        }
    }

    #[test]
    fn what_a_single_velocity_explains_is_not_enough() {
        for is_of_aircraft in [false, true] {
            for speed_m_s in [0.0, 12.0] {
                let mut agreement = Agreement::default();
                agreement.leave_out();
                let after_s = used_again_s(&mut agreement, is_of_aircraft, |_| speed_m_s, |_| 0.0);
                assert_eq!(after_s, None, "{speed_m_s} m/s all along");
            }
        }
    }

    #[test]
    fn a_velocity_that_is_wrong_now_and_then_stays_left_out() {
        for is_of_aircraft in [false, true] {
            let mut agreement = Agreement::default();
            agreement.leave_out();
            let now_and_then = |second: usize| if second % 50 < 10 { 6.0 } else { 0.0 };
            let after_s = used_again_s(
                &mut agreement,
                is_of_aircraft,
                there_and_back_m_s,
                now_and_then,
            );
            assert_eq!(after_s, None);
        }
    }
}
