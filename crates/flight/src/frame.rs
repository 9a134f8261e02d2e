//! What is known of one frame, and what it gave.

use grimnet_geo::LonLat;
use grimnet_locate::{LocateError, Outcome, Prior};
use grimnet_track::{Attitude, Input, InputError, TrackPoint};

/// What is known of a frame besides the photo, the telemetry and the track.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Known {
    /// Heading, height, field of view or ground resolution; each overrides the photo's metadata. `near` limits
    /// what is searched where no window is known.
    pub prior: Prior,
    /// Attitude of the camera at the exposure; its time is ignored. If it is `None`, the photo's metadata may have it.
    pub attitude: Option<Attitude>,
}

/// Where a frame was searched.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Searched {
    /// Around the position that the track predicts.
    Window {
        /// Expected image centre.
        centre: LonLat,
        /// Metres.
        radius_m: f64,
    },
    /// On the whole map, or in the area that the caller allows.
    WholeMap,
}

/// Wall time that a frame took, milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FrameTimeMs {
    /// Search on the map.
    pub locate: f64,
    /// All of it, decoding of the photo apart.
    pub total: f64,
}

/// What a frame gave.
#[derive(Debug)]
pub struct FrameAnswer {
    /// Exposure time, seconds.
    pub time_s: f64,
    /// The localiser's answer; an error if the photo is unusable. The flight goes on in either case.
    pub outcome: Result<Outcome, LocateError>,
    /// The search that gave this answer.
    pub searched: Searched,
    /// How many searches the frame took: the window, the whole map after it, each again where yaw or height of the telemetry may be wrong,
    /// and all of them twice for a tilted frame that is not found rectified.
    pub searches: u32,
    /// What the filter was given for this frame, in this order, whether it was taken or not.
    pub inputs: Vec<Input>,
    /// Whether the filter was restarted before it was given them: what it was given before was wrong ([`crate::Warning`]).
    pub after_restart: bool,
    /// Why the filter did not take some of it.
    pub refused: Vec<InputError>,
    /// The track at the frame's time. `None` if that is older than the filter can go back.
    pub point: Option<TrackPoint>,
    /// Wall time.
    pub time_ms: FrameTimeMs,
}
