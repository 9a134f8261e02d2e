//! The autopilot's clock on the link's clock.

use std::collections::VecDeque;

/// Round trips that are kept.
const KEPT: usize = 16;
/// A round trip that took longer says nothing, seconds.
const LONGEST_ROUND_TRIP_S: f64 = 0.5;
/// After so many round trips in a row that contradict what is kept, the kept ones are dropped.
const CONTRADICTIONS: usize = 3;
/// Arrivals are compared over about this long, seconds.
const ARRIVALS_S: f64 = 20.0;
/// A start that round trips and arrivals say so differently is that of two clocks, seconds.
const OTHER_CLOCK_S: f64 = 10.0;
/// A clock that goes back by more than this began again, seconds.
const RESTART_S: f64 = 1.0;

/// Estimates the time at which the autopilot started, on the link's clock.
///
/// From TIMESYNC: the autopilot read its clock between sending and arrival of a round trip, and the shortest round trip says
/// it best (as NTP's clock filter does, RFC 5905). Until then from arrivals: the earliest arrival, relative to the time stamp,
/// had the shortest way.
///
/// TIMESYNC may be of another clock than the time stamps: it counts on where those begin again after 2^32 milliseconds, and MAVLink does
/// not say what it counts from. Then the arrivals count.
#[derive(Debug, Default)]
pub(crate) struct TimeSync {
    /// Start of the autopilot and length of the round trip, seconds.
    round_trips: VecDeque<(f64, f64)>,
    contradictions: usize,
    /// Earliest start that arrivals allow: in the span before, and in this one with its beginning.
    previous_arrivals: Option<f64>,
    arrivals: Option<(f64, f64)>,
    /// Newest time stamp, seconds since start.
    newest_boot_s: Option<f64>,
}

impl TimeSync {
    /// Takes in the answer to a request: when it was sent and when the answer came (link's clock), and the autopilot's time.
    pub fn round_trip(&mut self, sent_s: f64, came_s: f64, boot_s: f64) {
        let length_s = came_s - sent_s;
        if !(0.0..=LONGEST_ROUND_TRIP_S).contains(&length_s) || !boot_s.is_finite() {
            return;
        }
        let start_s = 0.5 * (sent_s + came_s) - boot_s;
        if let Some(best_s) = self.best_round_trip()
            && (start_s - best_s).abs() > LONGEST_ROUND_TRIP_S
        {
            self.contradictions += 1;
            if self.contradictions < CONTRADICTIONS {
                return;
            }
            self.round_trips.clear();
        }
        self.contradictions = 0;
        if self.round_trips.len() == KEPT {
            self.round_trips.pop_front();
        }
        self.round_trips.push_back((start_s, length_s));
    }

    /// Takes in the time stamp of a message that came at `now_s`. Says whether the autopilot started again.
    pub fn arrival(&mut self, boot_s: f64, now_s: f64) -> bool {
        let restarted = self
            .newest_boot_s
            .is_some_and(|newest_s| boot_s < newest_s - RESTART_S);
        if restarted {
            *self = Self::default();
        }
        self.newest_boot_s = Some(
            self.newest_boot_s
                .map_or(boot_s, |newest| newest.max(boot_s)),
        );
        let start_s = now_s - boot_s;
        self.arrivals = match self.arrivals {
            Some((since_s, earliest_s)) if now_s - since_s <= ARRIVALS_S => {
                Some((since_s, earliest_s.min(start_s)))
            }
            before => {
                self.previous_arrivals = before.map(|(_, earliest_s)| earliest_s);
                Some((now_s, start_s))
            }
        };
        restarted
    }

    /// Forgets when the autopilot started, as after a silence in which it may have started again. A clock that goes back still shows
    /// that it did.
    pub fn forget_start(&mut self) {
        *self = Self {
            newest_boot_s: self.newest_boot_s,
            ..Self::default()
        };
    }

    /// A time since the autopilot's start on the link's clock. `None` before anything was heard.
    pub fn time_s(&self, boot_s: f64) -> Option<f64> {
        let earliest_s = self.arrivals.map(|(_, earliest_s)| {
            self.previous_arrivals
                .map_or(earliest_s, |previous_s| previous_s.min(earliest_s))
        });
        let is_of_stamps =
            |start_s: &f64| earliest_s.is_none_or(|s| (s - start_s).abs() <= OTHER_CLOCK_S);
        let round_trip_s = self.best_round_trip().filter(is_of_stamps);
        Some(round_trip_s.or(earliest_s)? + boot_s)
    }

    fn best_round_trip(&self) -> Option<f64> {
        let shortest = self.round_trips.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        shortest.map(|(start_s, _)| *start_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_round_trip_counts() {
        let mut sync = TimeSync::default();
        // Started at 100 s. The way there takes 10 ms; the way back 10 ms, and once 300 ms.
        sync.arrival(5.0, 105.2);
        assert_eq!(sync.time_s(5.0), Some(105.2));
        sync.round_trip(110.0, 110.31, 10.01);
        sync.round_trip(111.0, 111.02, 11.01);
        let time_s = sync.time_s(20.0).unwrap();
        assert!((time_s - 120.0).abs() < 1e-9, "{time_s}");
    }

    #[test]
    fn the_earliest_arrival_counts_and_is_forgotten() {
        let mut sync = TimeSync::default();
        for (boot_s, delay_s) in [(1.0, 0.2), (2.0, 0.05), (3.0, 0.4)] {
            assert!(!sync.arrival(boot_s, 100.0 + boot_s + delay_s));
        }
        assert!((sync.time_s(3.0).unwrap() - 103.05).abs() < 1e-9);
        // The clocks drift apart: after two spans the old minimum is gone.
        for step in 0..100 {
            let boot_s = 4.0 + f64::from(step);
            sync.arrival(boot_s, 101.0 + boot_s);
        }
        assert!((sync.time_s(3.0).unwrap() - 104.0).abs() < 1e-9);
    }

    #[test]
    fn a_restart_is_noticed() {
        let mut sync = TimeSync::default();
        sync.arrival(50.0, 100.0);
        sync.round_trip(100.0, 100.01, 50.005);
        // Swapped messages are no restart.
        assert!(!sync.arrival(49.5, 100.1));
        assert!(sync.arrival(0.5, 103.0));
        assert_eq!(sync.time_s(0.5), Some(103.0));
        sync.round_trip(103.0, 103.01, 0.505);
        assert!((sync.time_s(0.505).unwrap() - 103.005).abs() < 1e-9);
    }

    #[test]
    fn round_trips_of_another_clock_than_the_time_stamps_do_not_count() {
        let mut sync = TimeSync::default();
        // 2^32 milliseconds after the start.
        let wrap_s = 4_294_967.296;
        sync.arrival(wrap_s - 0.1, 100.0);
        sync.round_trip(100.0, 100.01, wrap_s - 0.095);
        assert!((sync.time_s(wrap_s).unwrap() - 100.1).abs() < 1e-6);
        assert!(sync.arrival(0.1, 100.2));
        sync.round_trip(100.5, 100.51, wrap_s + 0.405);
        assert!((sync.time_s(0.4).unwrap() - 100.5).abs() < 1e-6);
    }

    #[test]
    fn round_trips_of_another_clock_win_in_the_end() {
        let mut sync = TimeSync::default();
        sync.round_trip(100.0, 100.01, 10.0);
        for at in 0..3 {
            let sent_s = 200.0 + f64::from(at);
            sync.round_trip(sent_s, sent_s, f64::from(at));
        }
        assert_eq!(sync.time_s(0.0), Some(200.0));
        // A round trip without sense changes nothing.
        sync.round_trip(300.0, 299.0, 5.0);
        sync.round_trip(300.0, 300.0, f64::NAN);
        assert_eq!(sync.time_s(0.0), Some(200.0));
    }
}
