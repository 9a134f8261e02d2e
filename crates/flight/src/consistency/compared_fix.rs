//! A fix and what it is compared with.

use grimnet_geo::LonLat;

/// A fix, and where it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlacedFix {
    /// Seconds.
    pub time_s: f64,
    /// Where it is: the aircraft if the attitude is known, else the image centre.
    pub place: LonLat,
    /// Whether it is the aircraft.
    pub is_of_aircraft: bool,
    /// Where the track is at its time, if that may be used.
    pub track: Option<LonLat>,
}

/// A fix, beside it what was reported and measured by its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct ComparedFix {
    pub fix: PlacedFix,
    /// What the reported velocities add up to, metres east and north of any place.
    pub reported_en_m: [f64; 2],
    /// The motions between frames up to it, if there are any.
    pub motions: Option<MotionSum>,
    /// Whether the track accepted it.
    pub is_accepted: bool,
}

/// The sum of motions between frames that follow each other over ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotionSum {
    /// Time of the first frame, seconds.
    pub from_s: f64,
    /// Metres towards the top and the right of the photos.
    pub moved_m: [f64; 2],
}
