//! What the reported velocities add up to, at any time of the latest half minute: photos may arrive seconds after they were exposed.

use std::collections::VecDeque;

use grimnet_track::Velocity;

/// Velocities further apart than this are not added up, seconds.
const LONGEST_GAP_S: f64 = 1.5;
/// Velocities are kept for so long, seconds.
const KEPT_S: f64 = 30.0;
/// A path that gets longer begins again, metres: one velocity that no aircraft can have would leave no digits for those after it.
const LONGEST_PATH_M: f64 = 1e9;

/// A velocity, and where the ones up to it lead.
#[derive(Debug, Clone, Copy)]
struct Leg {
    velocity: Velocity,
    /// Metres east and north of any place.
    path_en_m: [f64; 2],
}

impl Leg {
    /// The path at a time near its own, along its velocity.
    fn extended_to(&self, time_s: f64) -> Reported {
        let since_s = time_s - self.velocity.time_s;
        let [east_m, north_m] = self.path_en_m;
        Reported {
            path_en_m: [
                east_m + self.velocity.east_m_s * since_s,
                north_m + self.velocity.north_m_s * since_s,
            ],
            sigma_m_s: self.velocity.sigma_m_s,
        }
    }
}

/// What was reported of a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reported {
    /// What the velocities add up to, metres east and north of any place.
    pub path_en_m: [f64; 2],
    /// Error of the velocities, metres per second, 1 sigma.
    pub sigma_m_s: f64,
}

/// Integrates velocities (trapezoids).
#[derive(Debug, Clone, Default)]
pub(super) struct ReportedPath {
    /// By time, without a gap.
    legs: VecDeque<Leg>,
}

impl ReportedPath {
    /// Takes in a velocity; one that is not newer than the last changes nothing. Gives whether there was a gap before it, or the path
    /// became too long: what was added up before does not go with what follows.
    pub fn add(&mut self, velocity: &Velocity) -> bool {
        let Some(before) = self.legs.back().copied() else {
            self.legs.push_back(Leg {
                velocity: *velocity,
                path_en_m: [0.0; 2],
            });
            return false;
        };
        let interval_s = velocity.time_s - before.velocity.time_s;
        if interval_s <= 0.0 {
            return false;
        }
        let [east_m, north_m] = before.path_en_m;
        let mean = |a: f64, b: f64| 0.5 * (a + b) * interval_s;
        let mut path_en_m = [
            east_m + mean(before.velocity.east_m_s, velocity.east_m_s),
            north_m + mean(before.velocity.north_m_s, velocity.north_m_s),
        ];
        let is_too_long = path_en_m[0].hypot(path_en_m[1]) > LONGEST_PATH_M;
        let begins_again = is_too_long || interval_s > LONGEST_GAP_S;
        if begins_again {
            self.legs.clear();
            path_en_m = [0.0; 2];
        }
        self.legs.push_back(Leg {
            velocity: *velocity,
            path_en_m,
        });
        let oldest_s = velocity.time_s - KEPT_S;
        while self
            .legs
            .front()
            .is_some_and(|leg| leg.velocity.time_s < oldest_s)
        {
            self.legs.pop_front();
        }
        begins_again
    }

    /// What was reported of a time. `None` if no velocity is near.
    pub fn at(&self, time_s: f64) -> Option<Reported> {
        let after = self
            .legs
            .partition_point(|leg| leg.velocity.time_s <= time_s);
        let leg = self.legs.get(after.saturating_sub(1))?;
        let is_near = (time_s - leg.velocity.time_s).abs() <= LONGEST_GAP_S;
        is_near.then(|| leg.extended_to(time_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Velocities ten times a second that grow by 1 m/s each second, to the east.
    fn accelerated(duration_s: f64) -> ReportedPath {
        let mut path = ReportedPath::default();
        for tick in 0..=(duration_s * 10.0) as u32 {
            let time_s = f64::from(tick) * 0.1;
            path.add(&Velocity {
                time_s,
                east_m_s: time_s,
                north_m_s: 0.0,
                sigma_m_s: 0.3,
            });
        }
        path
    }

    #[test]
    fn the_path_is_the_integral_of_the_velocities_at_past_times_too() {
        let path = accelerated(20.0);
        for time_s in [0.0, 3.0, 12.34, 20.0, 20.5] {
            let [east_m, north_m] = path.at(time_s).unwrap().path_en_m;
            // Between velocities the last one is taken to go on.
            assert!((east_m - 0.5 * time_s * time_s).abs() < 0.2, "{time_s}");
            assert_eq!(north_m, 0.0);
        }
        assert!(path.at(22.0).is_none(), "long after the last velocity");
        assert!(accelerated(60.0).at(25.0).is_none(), "too long ago");
    }

    #[test]
    fn a_velocity_that_no_aircraft_can_have_does_not_stay_in_the_path() {
        let mut path = accelerated(1.0);
        let mut begins_again = 0;
        for tick in 11..=40 {
            begins_again += usize::from(path.add(&Velocity {
                time_s: f64::from(tick) * 0.1,
                east_m_s: if tick == 11 { 3e38 } else { 10.0 },
                north_m_s: 0.0,
                sigma_m_s: 0.3,
            }));
        }
        let east_m = |time_s: f64| path.at(time_s).unwrap().path_en_m[0];
        let moved_m = east_m(3.0) - east_m(2.0);
        assert!((moved_m - 10.0).abs() < 1e-6, "{moved_m}");
        assert_eq!(begins_again, 2);
    }

    #[test]
    fn a_gap_ends_the_path_and_old_velocities_change_nothing() {
        let mut path = accelerated(10.0);
        let velocity = |time_s| Velocity {
            time_s,
            east_m_s: 100.0,
            north_m_s: 0.0,
            sigma_m_s: 0.3,
        };
        let before = path.at(10.0).unwrap().path_en_m;
        assert!(!path.add(&velocity(9.0)));
        assert_eq!(path.at(10.0).unwrap().path_en_m, before);
        assert!(path.add(&velocity(12.0)));
        assert!(path.at(10.0).is_none());
        assert!(path.at(12.0).is_some());
    }
}
