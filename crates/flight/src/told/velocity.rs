//! Whether the velocities of the telemetry are those of the flight that its fixes show.
//!
//! Velocities in another unit, or along other axes, make every fix look wrong, so that a filter that trusts them believes none. The
//! distance from fix to fix over what the velocities add up to is then a factor and a turn that are the same all along. Velocities
//! that become wrong during the flight show sooner, in fixes that the track does not believe ([`super::unbelieved`]).

use std::collections::VecDeque;

use grimnet_geo::{LonLat, offset_en_m};
use grimnet_track::Velocity;

use super::unbelieved::{Unbelieved, UnbelievedFixes};

/// Fixes closer to each other than this say little, metres: tilt alone moves the image centre by tens of metres.
const LEAST_DISTANCE_M: f64 = 40.0;
/// Fixes further apart in time than this are not compared, seconds.
const LONGEST_S: f64 = 20.0;
/// No small drone is faster, metres per second: of two fixes further apart one is of another place.
const MOST_SPEED_M_S: f64 = 60.0;
/// Velocities further apart than this are not added up, seconds.
const LONGEST_GAP_S: f64 = 1.5;
/// So many of the latest comparisons are kept.
const COMPARISONS: usize = 12;
/// So many of them must agree on a factor: fixes of wrong places agree on none.
const NEEDED: usize = 8;
/// Comparisons agree if they are this close, relative to their factor.
const AGREEMENT: f64 = 0.2;
/// A factor and turn this far from none is doubted, relative.
const LEAST_DOUBT: f64 = 0.35;
/// A velocity that is off by no more than so many of its standard deviations is as good as it says.
const SIGMAS: f64 = 3.0;

/// By how much told velocities differ from those that fixes show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityDoubt {
    /// Told over true speed.
    pub factor: f64,
    /// From the true to the told direction, degrees clockwise, -180 to 180.
    pub turn_deg: f64,
}

impl std::fmt::Display for VelocityDoubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the velocities of the telemetry are {:.1} times as fast as the fixes show and {:.0} degrees off their direction: \
             metres per second to the east and north were expected",
            self.factor,
            // Without the sign of a zero.
            self.turn_deg.round() + 0.0
        )
    }
}

/// Compares velocities with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct ToldVelocity {
    /// The fix that distances are taken from, and its time in seconds.
    from: Option<(f64, LonLat)>,
    /// The latest velocity.
    latest: Option<Velocity>,
    /// What the velocities add up to since that fix, metres east and north. `None` if there was a gap.
    moved_en_m: Option<[f64; 2]>,
    /// Told over seen displacements.
    ratios: VecDeque<Ratio>,
    /// What all velocities so far add up to, metres east and north.
    path_en_m: [f64; 2],
    unbelieved: UnbelievedFixes,
    doubt: Option<VelocityDoubt>,
}

impl ToldVelocity {
    /// Takes in a velocity. One that is not newer than the last changes nothing.
    pub fn velocity(&mut self, told: &Velocity) {
        let Some(before) = self.latest else {
            self.latest = Some(*told);
            return;
        };
        let interval_s = told.time_s - before.time_s;
        if interval_s <= 0.0 {
            return;
        }
        if interval_s > LONGEST_GAP_S {
            self.moved_en_m = None;
            self.unbelieved.clear();
        }
        let step_en_m = [
            0.5 * (before.east_m_s + told.east_m_s) * interval_s,
            0.5 * (before.north_m_s + told.north_m_s) * interval_s,
        ];
        let farther = |[east_m, north_m]: [f64; 2]| [east_m + step_en_m[0], north_m + step_en_m[1]];
        self.moved_en_m = self.moved_en_m.map(farther);
        self.path_en_m = farther(self.path_en_m);
        self.latest = Some(*told);
    }

    /// Takes in a fix, and where the track was at its time if that may be used. Velocities that are told after it count for the next
    /// one. A fix whose heading is another one (`has_told_heading`) is of another place.
    pub fn fix(
        &mut self,
        time_s: f64,
        place: LonLat,
        track: Option<LonLat>,
        has_told_heading: bool,
    ) {
        let recent = |latest: &Velocity| (latest.time_s - time_s).abs() <= LONGEST_GAP_S;
        let told = self.latest.filter(recent);
        match told {
            Some(told) if has_told_heading => {
                let since_s = time_s - told.time_s;
                self.unbelieved.add(Unbelieved {
                    time_s,
                    place,
                    track,
                    told_en_m: [
                        self.path_en_m[0] + told.east_m_s * since_s,
                        self.path_en_m[1] + told.north_m_s * since_s,
                    ],
                });
            }
            Some(_) => {}
            None => self.unbelieved.clear(),
        }
        self.compare(time_s, place, told);
        if self.doubt.is_none() {
            self.doubt = self
                .doubt_of_comparisons()
                .or_else(|| self.doubt_of_unbelieved(told?));
        }
    }

    /// The track believed the last fix.
    pub fn believed(&mut self) {
        self.unbelieved.clear();
    }

    /// Compares the distance from an earlier fix with what was told.
    fn compare(&mut self, time_s: f64, place: LonLat, told: Option<Velocity>) {
        if let (Some((from_s, from)), Some(told_en_m)) = (self.from, self.moved_en_m) {
            let (east_m, north_m) = offset_en_m(from, place);
            let (apart_m, apart_s) = (east_m.hypot(north_m), time_s - from_s);
            let told = told.filter(|_| (0.0..=LONGEST_S).contains(&apart_s));
            if told.is_some() && apart_m < LEAST_DISTANCE_M {
                return;
            }
            if let Some(told) = told
                && apart_m < MOST_SPEED_M_S * apart_s
            {
                let off_m = (told_en_m[0] - east_m).hypot(told_en_m[1] - north_m);
                let is_as_stated = off_m <= SIGMAS * told.sigma_m_s * apart_s;
                self.ratios.push_back(if is_as_stated {
                    Ratio::SAME
                } else {
                    Ratio::of(told_en_m, [east_m, north_m])
                });
                if self.ratios.len() > COMPARISONS {
                    self.ratios.pop_front();
                }
            }
        }
        self.from = Some((time_s, place));
        self.moved_en_m = told.map(|_| [0.0; 2]);
    }

    /// What is doubted; once it is, it stays so.
    pub fn doubt(&self) -> Option<VelocityDoubt> {
        self.doubt
    }

    fn doubt_of_unbelieved(&self, told: Velocity) -> Option<VelocityDoubt> {
        let moved = self.unbelieved.contradiction(told.sigma_m_s)?;
        Some(Ratio::of(moved.told_en_m, moved.seen_en_m).doubt())
    }

    /// What is doubted, if enough comparisons agree on it.
    fn doubt_of_comparisons(&self) -> Option<VelocityDoubt> {
        // The comparison that most others agree with.
        let agreeing = |with: &Ratio| {
            let near = AGREEMENT * with.size().max(1.0);
            self.ratios
                .iter()
                .filter(|ratio| ratio.away_from(with) <= near)
                .copied()
                .collect::<Vec<_>>()
        };
        let agreed = self.ratios.iter().map(agreeing).max_by_key(Vec::len)?;
        if agreed.len() < NEEDED {
            return None;
        }
        let mean = Ratio::mean(&agreed);
        let doubted = mean.away_from(&Ratio::SAME) > LEAST_DOUBT;
        doubted.then(|| mean.doubt())
    }
}

/// One displacement over another: the part along it and the part to its right.
#[derive(Debug, Clone, Copy)]
struct Ratio {
    ahead: f64,
    right: f64,
}

impl Ratio {
    const SAME: Self = Self {
        ahead: 1.0,
        right: 0.0,
    };

    fn of([told_east, told_north]: [f64; 2], [east, north]: [f64; 2]) -> Self {
        let square = east * east + north * north;
        Self {
            ahead: (told_east * east + told_north * north) / square,
            right: (told_east * north - told_north * east) / square,
        }
    }

    fn mean(ratios: &[Self]) -> Self {
        let mean = |of: fn(&Self) -> f64| ratios.iter().map(of).sum::<f64>() / ratios.len() as f64;
        Self {
            ahead: mean(|ratio| ratio.ahead),
            right: mean(|ratio| ratio.right),
        }
    }

    fn size(&self) -> f64 {
        self.ahead.hypot(self.right)
    }

    fn away_from(&self, other: &Self) -> f64 {
        (self.ahead - other.ahead).hypot(self.right - other.right)
    }

    fn doubt(&self) -> VelocityDoubt {
        VelocityDoubt {
            factor: self.size(),
            turn_deg: self.right.atan2(self.ahead).to_degrees(),
        }
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::destination_en_m;

    use super::*;

    const HERE: LonLat = LonLat::new(1.5, 1.0);

    /// A flight at 10 m/s on a wide circle with a fix every second, of which every `alias_every`th is of another place.
    fn flown(told: impl Fn([f64; 2]) -> [f64; 2], alias_every: usize) -> Option<VelocityDoubt> {
        let mut check = ToldVelocity::default();
        for tick in 0..1200usize {
            let time_s = tick as f64 * 0.1;
            let angle_rad = time_s / 30.0;
            let [east_m_s, north_m_s] = told([10.0 * angle_rad.cos(), 10.0 * angle_rad.sin()]);
            check.velocity(&Velocity {
                time_s,
                east_m_s,
                north_m_s,
                sigma_m_s: 0.3,
            });
            if tick % 10 == 0 {
                let wrong_m = if (tick / 10) % alias_every == alias_every - 1 {
                    300.0
                } else {
                    0.0
                };
                let east_m = 300.0 * angle_rad.sin() + wrong_m;
                let north_m = 300.0 * (1.0 - angle_rad.cos());
                check.fix(time_s, destination_en_m(HERE, east_m, north_m), None, true);
                check.believed();
            }
        }
        check.doubt()
    }

    #[test]
    fn another_unit_and_other_axes_are_told_and_right_velocities_are_not() {
        assert_eq!(flown(|v| v, usize::MAX), None);
        assert_eq!(flown(|v| v, 7), None);
        let twice = flown(|[e, n]| [2.0 * e, 2.0 * n], usize::MAX).unwrap();
        assert!(
            (twice.factor - 2.0).abs() < 0.05 && twice.turn_deg.abs() < 2.0,
            "{twice:?}"
        );
        let knots = flown(|[e, n]| [1.944 * e, 1.944 * n], 20).unwrap();
        assert!((knots.factor - 1.944).abs() < 0.05, "{knots:?}");
        let turned = flown(|[e, n]| [n, -e], usize::MAX).unwrap();
        assert!((turned.factor - 1.0).abs() < 0.05, "{turned:?}");
        assert!((turned.turn_deg - 90.0).abs() < 2.0, "{turned:?}");
        let opposite = flown(|[e, n]| [-e, -n], usize::MAX).unwrap();
        assert!(
            (opposite.turn_deg.abs() - 180.0).abs() < 2.0,
            "{opposite:?}"
        );
        let still = flown(|_| [0.0; 2], usize::MAX).unwrap();
        assert!(still.factor < 0.05, "{still:?}");
    }

    /// A flight at 10 m/s to the east with a fix every second that the track does not believe, and whose heading is the told one or
    /// not. Gives the seconds until the velocities are doubted, which become wrong at once.
    fn flown_beside(north_m_s: f64, sigma_m_s: f64, has_told_heading: bool) -> Option<usize> {
        let mut check = ToldVelocity::default();
        (0..60).find(|second| {
            for tick in 0..10 {
                check.velocity(&Velocity {
                    time_s: *second as f64 - 0.9 + 0.1 * f64::from(tick),
                    east_m_s: 10.0,
                    north_m_s,
                    sigma_m_s,
                });
            }
            let time_s = *second as f64;
            let place = destination_en_m(HERE, 10.0 * time_s, 0.0);
            check.fix(time_s, place, None, has_told_heading);
            check.doubt().is_some()
        })
    }

    #[test]
    fn fixes_that_the_track_does_not_believe_tell_sooner_and_it_stays_told() {
        // Too little for a factor of 0.35.
        assert!(flown_beside(3.0, 0.5, true).is_some_and(|second| second <= 5));
        assert_eq!(flown_beside(3.0, 0.5, false), None, "of another heading");
        assert_eq!(flown_beside(3.0, 2.0, true), None, "within its error");
        assert_eq!(flown_beside(0.0, 0.5, true), None);
    }
}
