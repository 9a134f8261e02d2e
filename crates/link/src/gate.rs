//! Which positions may leave, and when they jumped.

use grimnet_geo::{LonLat, offset_en_m};
use grimnet_track::{Estimate, PositionOf, Source, TrackPoint, TrackState};

use crate::event::NotSending;

/// A position this far from where the one before led to is a jump, metres, and at least [`JUMP_SIGMAS`].
const JUMP_M: f64 = 10.0;
/// As [`JUMP_M`], in standard deviations of the new position.
const JUMP_SIGMAS: f64 = 5.0;

/// A position that only the autopilot's own velocity carries on is sent for so long, seconds: ArduPilot's EKF3 gives up a position after 7
/// to 10 s without one.
const LONGEST_BY_OWN_VELOCITY_S: f64 = 10.0;

/// The position of a track at a time, if it may be given to an autopilot.
///
/// # Errors
/// Why not: the state is searching, ambiguous or lost; the 95 % radius is above `max_radius95_m`; or the position is that of
/// the image centre, whose distance from the aircraft nothing tells.
pub(crate) fn usable(
    point: Option<&TrackPoint>,
    max_radius95_m: f64,
) -> Result<(TrackState, Estimate), NotSending> {
    let point = point.ok_or(NotSending::NoPosition)?;
    let estimate = point
        .estimate
        .filter(|_| point.state.is_usable())
        .ok_or(NotSending::NoPosition)?;
    if estimate.position_of == PositionOf::ImageCentre {
        return Err(NotSending::ImageCentre);
    }
    if estimate.radius95_m <= max_radius95_m {
        Ok((point.state, estimate))
    } else {
        Err(NotSending::TooUncertain)
    }
}

/// Whether positions are carried on by the autopilot's own velocity.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct OwnVelocity {
    /// Also by the last one that it told, from which a position is predicted further.
    carries: bool,
}

impl OwnVelocity {
    /// Takes in what a position rests on. Says whether the autopilot's own velocity has carried it on for so long that it must not be
    /// sent back.
    ///
    /// It tells the autopilot nothing, whatever the error of that velocity, and hides from it that it is lost. One that is lost tells no
    /// velocity any more: what is predicted from its last one is no news to it either.
    pub fn is_sent_back(&mut self, state: TrackState, estimate: &Estimate) -> bool {
        self.carries = match estimate.source {
            Source::Velocity => true,
            Source::Prediction => self.carries && state == TrackState::Coasting,
            _ => false,
        };
        let is_old = |age_s: f64| age_s > LONGEST_BY_OWN_VELOCITY_S;
        self.carries
            && state == TrackState::Coasting
            && estimate.age_of_last_fix_s.is_none_or(is_old)
    }
}

/// Standard deviation along the longer axis of the position's ellipse, metres: for receivers that know one number.
pub(crate) fn sigma_m(estimate: &Estimate) -> f64 {
    let [ee, en, nn] = estimate.covariance_en_m2;
    let largest = 0.5 * (ee + nn) + (0.25 * (ee - nn).powi(2) + en * en).sqrt();
    largest.max(0.0).sqrt()
}

/// Counts jumps of the positions that are sent, for receivers that start again at one.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Jumps {
    /// Time and estimate that were sent last.
    last: Option<(f64, Estimate)>,
    interrupted: bool,
    count: u8,
}

impl Jumps {
    /// Says that nothing is sent now.
    pub fn interrupt(&mut self) {
        self.interrupted = true;
    }

    /// How many jumps there were, this position included. It wraps, as `reset_counter` of ODOMETRY does.
    ///
    /// A receiver puts such a position in the place of its own, so only one that fixes support counts as a jump.
    pub fn count(&mut self, time_s: f64, state: TrackState, estimate: &Estimate) -> u8 {
        if state == TrackState::Tracking
            && let Some((last_s, last)) = self.last
        {
            let after_s = time_s - last_s;
            let place = |estimate: &Estimate| LonLat::new(estimate.lon_deg, estimate.lat_deg);
            let (east_m, north_m) = offset_en_m(place(&last), place(estimate));
            let off_m = (east_m - last.velocity_east_m_s * after_s)
                .hypot(north_m - last.velocity_north_m_s * after_s);
            if self.interrupted || off_m > JUMP_M.max(JUMP_SIGMAS * sigma_m(estimate)) {
                self.count = self.count.wrapping_add(1);
            }
        }
        self.interrupted &= state != TrackState::Tracking;
        self.last = Some((time_s, *estimate));
        self.count
    }
}
