//! Whether the velocities of the telemetry are those of the flight that its fixes show.
//!
//! Velocities in another unit, or along other axes, make every fix look wrong, so that a filter that trusts them believes none. The
//! distance from fix to fix over what the velocities add up to is then a factor and a turn that are the same all along. Velocities
//! that become wrong during the flight, or of an aircraft that hovers, show in the displacement over seconds ([`super::displacement`]).

use std::collections::VecDeque;

use grimnet_geo::{LonLat, offset_en_m};
use grimnet_track::{RelativeMotion, Velocity};

use super::agreement::Agreement;
use super::compared_fix::PlacedFix;
use super::displacement::DisplacementTest;
use super::fix_path::{MOST_SPEED_M_S, Moved};
use super::plane_vector::difference;
use super::reported_path::{Reported, ReportedPath};

/// Fixes closer to each other than this say little, metres: tilt alone moves the image centre by tens of metres.
const LEAST_DISTANCE_M: f64 = 40.0;
/// Fixes further apart in time than this are not compared, seconds.
const LONGEST_S: f64 = 20.0;
/// So many of the latest comparisons are kept.
const COMPARISONS: usize = 12;
/// So many of them must agree on a factor: fixes of wrong places agree on none.
const NEEDED: usize = 8;
/// Comparisons agree if they are this close, relative to their factor.
const AGREEMENT: f64 = 0.2;
/// Comparisons agree only if fixes move at a speed within this factor, too.
const SAME_SPEED: f64 = 1.5;
/// A factor and turn this far from none is inconsistent, relative.
const LEAST_OFF: f64 = 0.35;
/// A motion counts if the surface itself moved by less than this, metres, 1 sigma: over ground and not over water.
const MOST_SURFACE_SIGMA_M: f64 = 0.5;
/// A velocity that is off by no more than so many of its standard deviations is as good as it says.
const SIGMAS: f64 = 3.0;

/// By how much reported velocities differ from those that fixes show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityWarning {
    /// Reported over true speed. Infinite where the aircraft stands still.
    pub factor: f64,
    /// From the true to the reported direction, degrees clockwise, -180 to 180; 0 where the aircraft stands still.
    pub turn_deg: f64,
}

impl std::fmt::Display for VelocityWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.factor.is_infinite() {
            return f.write_str(
                "the velocities of the telemetry are those of an aircraft that moves, while fixes and photos stand still: metres per \
                 second to the east and north were expected",
            );
        }
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

/// An earlier fix.
#[derive(Debug, Clone, Copy)]
struct Earlier {
    /// Seconds.
    time_s: f64,
    place: LonLat,
    /// What all velocities added up to by then, metres east and north.
    path_en_m: [f64; 2],
}

/// Compares velocities with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct VelocityCheck {
    /// The fix that distances are taken from. `None` if there was a gap since.
    from: Option<Earlier>,
    path: ReportedPath,
    /// Reported over measured displacements, and the measured speed, metres per second.
    ratios: VecDeque<(Ratio, f64)>,
    displacement: DisplacementTest,
    warning: Option<VelocityWarning>,
    /// Whether it is over, while there is one.
    agreement: Agreement,
    was_inconsistent: bool,
}

impl VelocityCheck {
    /// Takes in a velocity. One that is not newer than the last changes nothing.
    pub fn velocity(&mut self, reported: &Velocity) {
        if self.path.add(reported) {
            self.from = None;
            self.displacement.clear();
            self.agreement.end_row();
        }
    }

    /// Takes in a fix, which may have arrived late. One whose heading is not the expected one is of another place.
    pub fn fix(&mut self, fix: PlacedFix, has_expected_heading: bool) {
        let time_s = fix.time_s;
        let reported = self.path.at(time_s);
        match &reported {
            Some(reported) if has_expected_heading => {
                self.displacement.add(fix, reported.path_en_m)
            }
            Some(_) => {}
            None => self.displacement.clear(),
        }
        self.compare(time_s, fix.place, reported);
        let found = self
            .warning_of_comparisons()
            .or_else(|| self.warning_of_displacement(reported?));
        if found.is_none() {
            return;
        }
        if self.warning.is_some() {
            self.agreement.end_row();
        } else {
            self.warning = found;
            self.was_inconsistent = true;
            self.agreement.leave_out();
        }
    }

    /// The track accepted the last fix.
    pub fn accepted(&mut self) {
        self.displacement.accepted();
        if self.warning.is_some()
            && let Some(leg) = self.displacement.accepted_leg()
            && let Some(reported) = self.path.at(leg.time_s)
            && self.agreement.take(&leg, reported.sigma_m_s)
        {
            self.warning = None;
        }
    }

    /// Takes in the motion between two frames, after the fix of the second one. `gsd_m` is the ground resolution of its pixels, and a
    /// picture that is the same again (`is_new_picture`) is of a camera that hangs.
    pub fn motion(&mut self, motion: &RelativeMotion, gsd_m: f64, is_new_picture: bool) {
        let is_of_ground = motion
            .surface_sigma_px
            .is_some_and(|sigma_px| sigma_px * gsd_m < MOST_SURFACE_SIGMA_M);
        let moved_m = [motion.forward_px * gsd_m, motion.right_px * gsd_m];
        self.displacement.add_motion(
            [motion.from_time_s, motion.time_s],
            (is_of_ground && is_new_picture).then_some(moved_m),
        );
    }

    /// Forgets the times of all that was taken in: the clock was set.
    pub fn restart_clock(&mut self) {
        self.from = None;
        self.path = ReportedPath::default();
        self.displacement = DisplacementTest::default();
        self.agreement.end_row();
    }

    /// Compares the distance from an earlier fix with what was reported.
    fn compare(&mut self, time_s: f64, place: LonLat, reported: Option<Reported>) {
        if let Some(from) = self.from {
            let (east_m, north_m) = offset_en_m(from.place, place);
            let (apart_m, apart_s) = (east_m.hypot(north_m), time_s - from.time_s);
            let is_late = apart_s <= 0.0;
            let reported = reported.filter(|_| apart_s <= LONGEST_S);
            if is_late || reported.is_some() && apart_m < LEAST_DISTANCE_M {
                return;
            }
            if let Some(reported) = reported
                && apart_m < MOST_SPEED_M_S * apart_s
            {
                let reported_en_m = difference(reported.path_en_m, from.path_en_m);
                let off_m = (reported_en_m[0] - east_m).hypot(reported_en_m[1] - north_m);
                let is_as_stated = off_m <= SIGMAS * reported.sigma_m_s * apart_s;
                let ratio = if is_as_stated {
                    Ratio::SAME
                } else {
                    Ratio::of(reported_en_m, [east_m, north_m])
                };
                self.ratios.push_back((ratio, apart_m / apart_s));
                if self.ratios.len() > COMPARISONS {
                    self.ratios.pop_front();
                }
            }
        }
        self.from = reported.map(|reported| Earlier {
            time_s,
            place,
            path_en_m: reported.path_en_m,
        });
    }

    /// What is inconsistent, until velocities agree with the fixes again.
    pub fn warning(&self) -> Option<VelocityWarning> {
        self.warning
    }

    /// Whether velocities were inconsistent at any time.
    pub fn was_inconsistent(&self) -> bool {
        self.was_inconsistent
    }

    fn warning_of_displacement(&self, reported: Reported) -> Option<VelocityWarning> {
        let Moved {
            reported_en_m,
            measured_en_m,
        } = self.displacement.inconsistency(reported.sigma_m_s)?;
        Some(measured_en_m.map_or(
            VelocityWarning {
                factor: f64::INFINITY,
                turn_deg: 0.0,
            },
            |measured_en_m| Ratio::of(reported_en_m, measured_en_m).warning(),
        ))
    }

    /// What is inconsistent, if enough comparisons agree on it.
    fn warning_of_comparisons(&self) -> Option<VelocityWarning> {
        // The comparison that most others agree with.
        let agreeing = |(with, with_m_s): &(Ratio, f64)| {
            let near = AGREEMENT * with.size().max(1.0);
            // Jumps to other places are short of what was reported too, but at any speed.
            let is_as_fast =
                |speed_m_s: f64| (1.0 / SAME_SPEED..SAME_SPEED).contains(&(speed_m_s / with_m_s));
            self.ratios
                .iter()
                .filter(|(ratio, m_s)| ratio.away_from(with) <= near && is_as_fast(*m_s))
                .map(|(ratio, _)| *ratio)
                .collect::<Vec<_>>()
        };
        let agreed = self.ratios.iter().map(agreeing).max_by_key(Vec::len)?;
        if agreed.len() < NEEDED {
            return None;
        }
        let mean = Ratio::mean(&agreed);
        let is_inconsistent = mean.away_from(&Ratio::SAME) > LEAST_OFF;
        is_inconsistent.then(|| mean.warning())
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

    fn of([reported_east, reported_north]: [f64; 2], [east, north]: [f64; 2]) -> Self {
        let square = east * east + north * north;
        Self {
            ahead: (reported_east * east + reported_north * north) / square,
            right: (reported_east * north - reported_north * east) / square,
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

    fn warning(&self) -> VelocityWarning {
        VelocityWarning {
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

    /// A fix without a track beside it.
    fn placed(time_s: f64, place: LonLat) -> PlacedFix {
        PlacedFix {
            time_s,
            place,
            is_of_aircraft: false,
            track: None,
        }
    }

    /// A flight at 10 m/s on a wide circle with a fix every second, of which every `alias_every`th is of another place.
    fn flown(
        reported: impl Fn([f64; 2]) -> [f64; 2],
        alias_every: usize,
    ) -> Option<VelocityWarning> {
        let mut check = VelocityCheck::default();
        for tick in 0..1200usize {
            let time_s = tick as f64 * 0.1;
            let angle_rad = time_s / 30.0;
            let [east_m_s, north_m_s] = reported([10.0 * angle_rad.cos(), 10.0 * angle_rad.sin()]);
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
                let place = destination_en_m(HERE, east_m, north_m);
                check.fix(placed(time_s, place), true);
            }
        }
        check.warning()
    }

    #[test]
    fn another_unit_and_other_axes_are_noticed_and_right_velocities_are_consistent() {
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

    /// A flight at 10 m/s to the east with a fix every second that the track rejects, and whose heading is the expected one or not.
    /// Gives the seconds until the velocities are inconsistent, which become wrong at once.
    fn flown_beside(north_m_s: f64, sigma_m_s: f64, has_expected_heading: bool) -> Option<usize> {
        let mut check = VelocityCheck::default();
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
            let fix = PlacedFix {
                is_of_aircraft: true,
                // Carried on by the velocities.
                track: Some(destination_en_m(HERE, 10.0 * time_s, north_m_s * time_s)),
                ..placed(time_s, place)
            };
            check.fix(fix, has_expected_heading);
            check.warning().is_some()
        })
    }

    #[test]
    fn fixes_that_the_track_rejects_show_it_sooner() {
        // Too little for a factor of 0.35.
        assert!(flown_beside(3.0, 0.5, true).is_some_and(|second| second <= 5));
        assert_eq!(flown_beside(3.0, 0.5, false), None, "of another heading");
        assert_eq!(flown_beside(3.0, 2.0, true), None, "within its error");
        assert_eq!(flown_beside(0.0, 0.5, true), None);
    }
}
