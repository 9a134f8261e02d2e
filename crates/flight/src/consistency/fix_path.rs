//! The way from an earlier fix to the latest one, and whether fixes and reported velocities agree on it.

use std::ops::RangeInclusive;

use grimnet_geo::{LonLat, offset_en_m};

use super::compared_fix::ComparedFix;
use super::plane_vector::{difference, length};

/// So many fixes must agree on one path, the latest among them.
pub(super) const NEEDED: usize = 4;
/// One of them at least must be in this part of the time between the first and the last, as a share: fixes that jump to another place
/// lie at its ends only.
const MIDDLE: RangeInclusive<f64> = 0.25..=0.75;
/// So many of the fixes between the first and the last that agree, as a share.
const SHARE: f64 = 0.75;
/// They must be of so long a time at least, seconds: a gust tilts the camera and moves the image centre for a moment.
const LEAST_TIME_S: f64 = 2.5;
/// Fixes are on the path up to this distance, metres: their own error, and a camera that moves by one or two degrees.
const ON_PATH_M: f64 = 4.0;
/// So far they must move away from what was reported, and from the track, metres. Fixes that move less stand still.
const LEAST_MOVED_M: f64 = 12.0;
/// So far away from what was reported where the attitude is unknown, metres: the tilt of a turn moves the image centre.
const LEAST_MOVED_OF_CENTRE_M: f64 = 40.0;
/// So far away from what was reported where no track can be used, metres: it may hold several places, and so explains no fix,
const LEAST_MOVED_WITHOUT_TRACK_M: f64 = 60.0;
/// over so long a time, seconds.
const LEAST_TIME_WITHOUT_TRACK_S: f64 = 4.0;
/// No small drone is faster, metres per second: of two fixes further apart one is of another place.
pub(super) const MOST_SPEED_M_S: f64 = 60.0;
/// The reported velocity must be off by more than so many of its standard deviations.
const SIGMAS: f64 = 3.0;
/// A track that accepts the fixes knows of a small error of the velocities. They are then inconsistent only if they are off by more than
/// so many standard deviations,
const SIGMAS_WHILE_ACCEPTED: f64 = 5.0;
/// and this far besides, metres: in a banked turn a fix and the attitude place the aircraft to about ten metres,
const LEAST_MOVED_WHILE_ACCEPTED_M: f64 = 20.0;
/// over so long a time, seconds.
const LEAST_TIME_WHILE_ACCEPTED_S: f64 = 4.0;
/// Motion between frames of less than this share of the reported displacement says that the camera stands still.
const STILL_SHARE: f64 = 0.5;

/// How far an aircraft moved, metres east and north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moved {
    /// By the reported velocities.
    pub reported_en_m: [f64; 2],
    /// By the fixes. `None` if they stand still.
    pub measured_en_m: Option<[f64; 2]>,
}

/// A fix with its place and that of the track in the plane around the latest fix, metres east and north.
#[derive(Debug, Clone, Copy)]
pub(super) struct InPlane {
    compared: ComparedFix,
    place_en_m: [f64; 2],
    track_en_m: Option<[f64; 2]>,
}

impl InPlane {
    pub fn new(compared: &ComparedFix, origin: LonLat) -> Self {
        let en_m = |place| offset_en_m(origin, place).into();
        Self {
            compared: *compared,
            place_en_m: en_m(compared.fix.place),
            track_en_m: compared.fix.track.map(en_m),
        }
    }

    /// By how much the fix is off what the velocities reported by then, with another start of either, metres.
    fn off_reported_en_m(&self) -> [f64; 2] {
        difference(self.place_en_m, self.compared.reported_en_m)
    }
}

/// Fixes by time, of which the last is the latest one.
#[derive(Debug, Clone, Copy)]
pub(super) struct FixPath<'a> {
    fixes: &'a [InPlane],
    first: &'a InPlane,
    last: &'a InPlane,
    interval_s: f64,
    /// How far the fixes moved.
    measured_en_m: [f64; 2],
    /// How far the velocities say.
    reported_en_m: [f64; 2],
    /// The one less the other.
    drift_en_m: [f64; 2],
}

impl<'a> FixPath<'a> {
    /// `None` without a fix.
    pub fn new(fixes: &'a [InPlane]) -> Option<Self> {
        let (first, last) = (fixes.first()?, fixes.last()?);
        let measured_en_m = difference(last.place_en_m, first.place_en_m);
        let reported_en_m = difference(last.compared.reported_en_m, first.compared.reported_en_m);
        Some(Self {
            fixes,
            first,
            last,
            interval_s: last.compared.fix.time_s - first.compared.fix.time_s,
            measured_en_m,
            reported_en_m,
            drift_en_m: difference(measured_en_m, reported_en_m),
        })
    }

    /// Whether the fixes agree on a path that velocities with this error do not allow.
    pub fn contradicts(&self, reported_sigma_m_s: f64) -> bool {
        let sigma_m = reported_sigma_m_s * self.interval_s;
        self.is_possible() && (self.is_off(sigma_m) || self.is_far_off(sigma_m)) && self.is_even()
    }

    /// How far it leads.
    pub fn moved(&self) -> Moved {
        Moved {
            reported_en_m: self.reported_en_m,
            measured_en_m: Some(self.measured_en_m).filter(|_| !self.stands_still()),
        }
    }

    /// Whether an aircraft can have moved so.
    fn is_possible(&self) -> bool {
        self.interval_s >= LEAST_TIME_S
            && length(self.measured_en_m) < MOST_SPEED_M_S * self.interval_s
            && (!self.stands_still() || self.motion_stands_still())
    }

    fn stands_still(&self) -> bool {
        length(self.measured_en_m) < LEAST_MOVED_M
    }

    /// Whether the motions between frames say that the camera stands still, up to the last fix but one: a map that looks alike along a
    /// road holds fixes back as well.
    fn motion_stands_still(&self) -> bool {
        let [from, .., to, _] = self.fixes else {
            return false;
        };
        let (from, to) = (&from.compared, &to.compared);
        let reported_m = length(difference(to.reported_en_m, from.reported_en_m));
        from.motions.zip(to.motions).is_some_and(|(before, now)| {
            before.from_s == now.from_s
                && length(difference(now.moved_m, before.moved_m)) < STILL_SHARE * reported_m
        })
    }

    /// Whether it leads away from what was reported and from a track that accepts none of its fixes.
    fn is_off(&self, sigma_m: f64) -> bool {
        let least_moved_m = if self.last.compared.fix.is_of_aircraft {
            LEAST_MOVED_M
        } else {
            LEAST_MOVED_OF_CENTRE_M
        };
        length(self.drift_en_m) > (SIGMAS * sigma_m).hypot(least_moved_m)
            && self.leaves_the_track()
            && !self.fixes.iter().any(|fix| fix.compared.is_accepted)
    }

    /// Whether it leads away from the track; where none can be used at its ends, far away from what was reported.
    fn leaves_the_track(&self) -> bool {
        let Some((before, now)) = self.first.track_en_m.zip(self.last.track_en_m) else {
            return self.interval_s >= LEAST_TIME_WITHOUT_TRACK_S
                && length(self.drift_en_m) > LEAST_MOVED_WITHOUT_TRACK_M;
        };
        length(difference(self.measured_en_m, difference(now, before))) > LEAST_MOVED_M
    }

    /// Whether it leads so far away from what was reported that it does not matter whether the track accepts its fixes.
    fn is_far_off(&self, sigma_m: f64) -> bool {
        self.interval_s >= LEAST_TIME_WHILE_ACCEPTED_S
            && length(self.drift_en_m)
                > SIGMAS_WHILE_ACCEPTED * sigma_m + LEAST_MOVED_WHILE_ACCEPTED_M
            // The image centre of an unknown tilt moves by itself.
            && (self.last.compared.fix.is_of_aircraft || self.stands_still())
    }

    /// Whether enough of the fixes move evenly away from what was reported.
    fn is_even(&self) -> bool {
        // When the fixes on the path were, as a share of the time between the first and the last.
        let on_path: Vec<f64> = self
            .fixes
            .iter()
            .filter_map(|fix| {
                let since_s = fix.compared.fix.time_s - self.first.compared.fix.time_s;
                let share = since_s / self.interval_s;
                let drifted_m = difference(fix.off_reported_en_m(), self.first.off_reported_en_m());
                let even_m = self.drift_en_m.map(|whole_m| share * whole_m);
                (length(difference(drifted_m, even_m)) <= ON_PATH_M).then_some(share)
            })
            .collect();
        on_path.len() >= NEEDED
            && on_path.len() as f64 >= SHARE * self.fixes.len() as f64
            && on_path.iter().any(|share| MIDDLE.contains(share))
    }
}
