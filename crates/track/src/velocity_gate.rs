//! Which reported velocities are used: no aircraft changes its velocity at once.

use crate::input::Velocity;

/// No aircraft that this filter is for accelerates faster, metres per second squared: a multirotor does 10 to 20, a small plane in a
/// steep turn about 3 g.
const MOST_ACCELERATION_M_S2: f64 = 30.0;
/// Two velocities may differ by so many standard deviations of their errors besides.
const SIGMAS: f64 = 3.0;
/// No aircraft that this filter is for flies faster, metres per second. A larger number is the place of a value that was missing, or
/// damaged; a velocity with a larger error says nothing.
const MOST_SPEED_M_S: f64 = 300.0;

/// How a velocity is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum VelocityUse {
    /// It continues those before.
    Continues,
    /// It is the second one in a row that contradicts those before and agrees with the other: the autopilot corrected its estimate, or
    /// lost it. Which of the two velocities is right is not known.
    Steps,
}

/// Leaves out velocities that no aircraft can have: all such as are too fast, and single ones that do not follow from those before.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct VelocityGate {
    used: Option<Velocity>,
    /// The last one, if it was left out.
    left_out: Option<Velocity>,
}

impl VelocityGate {
    /// Takes in a velocity that is not older than the last one. `None` if it is left out.
    pub fn take(&mut self, velocity: &Velocity) -> Option<VelocityUse> {
        let speed_m_s = velocity.east_m_s.hypot(velocity.north_m_s);
        if speed_m_s.max(velocity.sigma_m_s) > MOST_SPEED_M_S {
            return None;
        }
        let follows = |before: &Velocity| is_possible(before, velocity);
        let how = if self.used.as_ref().is_none_or(follows) {
            VelocityUse::Continues
        } else if self.left_out.as_ref().is_some_and(follows) {
            VelocityUse::Steps
        } else {
            self.left_out = Some(*velocity);
            return None;
        };
        *self = Self {
            used: Some(*velocity),
            left_out: None,
        };
        Some(how)
    }

    /// The last velocity that is used.
    pub fn latest(&self) -> Option<Velocity> {
        self.used
    }
}

/// Whether an aircraft can have one velocity after the other.
fn is_possible(before: &Velocity, after: &Velocity) -> bool {
    let change_m_s = (after.east_m_s - before.east_m_s).hypot(after.north_m_s - before.north_m_s);
    let interval_s = after.time_s - before.time_s;
    let error_m_s = SIGMAS * before.sigma_m_s.hypot(after.sigma_m_s);
    change_m_s <= MOST_ACCELERATION_M_S2 * interval_s + error_m_s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How velocities to the east are used that come four times a second.
    fn used<const N: usize>(east_m_s: [f64; N]) -> [Option<VelocityUse>; N] {
        let mut gate = VelocityGate::default();
        let mut time_s = 3.0;
        east_m_s.map(|east_m_s| {
            time_s += 0.25;
            gate.take(&Velocity {
                time_s,
                east_m_s,
                north_m_s: 2.0,
                sigma_m_s: 0.5,
            })
        })
    }

    const CONTINUES: Option<VelocityUse> = Some(VelocityUse::Continues);
    const STEPS: Option<VelocityUse> = Some(VelocityUse::Steps);

    #[test]
    fn a_single_impossible_velocity_is_left_out() {
        let single = used([10.0, 10.0, 110.0, 10.5, 10.0]);
        assert_eq!(single, [CONTINUES, CONTINUES, None, CONTINUES, CONTINUES]);
        let random = used([10.0, 110.0, -80.0, 10.0]);
        assert_eq!(random, [CONTINUES, None, None, CONTINUES]);
    }

    #[test]
    fn what_no_aircraft_flies_or_says_nothing_is_left_out_from_the_first_one_on() {
        let too_fast = used([9999.0, 9999.0, 10.0, 1e5, 10.5]);
        assert_eq!(too_fast, [None, None, CONTINUES, None, CONTINUES]);
        let mut gate = VelocityGate::default();
        let unknown = Velocity {
            time_s: 3.0,
            east_m_s: 10.0,
            north_m_s: 2.0,
            sigma_m_s: 1e6,
        };
        assert_eq!(gate.take(&unknown), None);
        assert_eq!(gate.latest(), None);
    }

    #[test]
    fn one_that_persists_is_a_step() {
        let step = used([10.0, 40.0, 41.0, 42.0]);
        assert_eq!(step, [CONTINUES, None, STEPS, CONTINUES]);
        let first = used([110.0, 10.0, 10.0, 10.0]);
        assert_eq!(first, [CONTINUES, None, STEPS, CONTINUES]);
    }

    #[test]
    fn braking_and_noise_are_possible() {
        let hard = used([20.0, 13.0, 6.0, -1.0, 1.1, -1.0]);
        assert_eq!(hard, [CONTINUES; 6]);
    }
}
