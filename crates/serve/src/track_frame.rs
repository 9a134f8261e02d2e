//! What one frame of a track gave, as clients and session files have it.

use grimnet_answer::Answer;
use grimnet_flight::Searched;
use grimnet_track::TrackPoint;
use serde::Serialize;

/// What one frame gave.
#[derive(Debug, Clone, Serialize, utoipa::ToSchema)]
pub struct TrackFrame {
    /// Number of the frame in its track, from 1.
    pub number: u64,
    /// Time of the exposure, seconds on the clock of the client.
    pub time_s: f64,
    /// Whether a window around the expected position was searched (`window`) or the whole map (`whole_map`).
    pub searched: &'static str,
    /// The track at that time; `null` for a frame that is too old, and while nothing is known of the aircraft, as after a
    /// first frame without texture.
    #[schema(value_type = Option<crate::track_point_schema::TrackPointSchema>)]
    pub point: Option<TrackPoint>,
    /// The answer for the photo alone; `used` and `set_aside` are empty.
    pub answer: Answer,
}

impl TrackFrame {
    /// What a frame gave, for which `searched` was searched. It keeps no evidence: that is the same for every frame of a flight, and
    /// many are kept.
    #[must_use]
    pub fn new(
        number: u64,
        time_s: f64,
        searched: &Searched,
        point: Option<TrackPoint>,
        answer: Answer,
    ) -> Self {
        Self {
            number,
            time_s,
            searched: match searched {
                Searched::Window { .. } => "window",
                _ => "whole_map",
            },
            point,
            answer: Answer {
                used: Vec::new(),
                set_aside: Vec::new(),
                ..answer
            },
        }
    }
}
