//! One instant of the track as it is written. Scripts rely on the field names: they must not change.

use grimnet_flight::FrameAnswer;
use grimnet_locate::Outcome;
use grimnet_photo::calendar;
use grimnet_track::{PositionOf, Source, TrackPoint, TrackState};
use serde::{Deserialize, Serialize};

use super::frame_time::Epoch;
use crate::errors;
use grimnet_answer::{TrackPlace, rounded, rounded_heading};

/// A time as it is written.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum TimeText {
    /// RFC 3339, UTC.
    Date(String),
    /// Seconds.
    Seconds(f64),
}

impl TimeText {
    /// A date if the seconds count from 1970, else the seconds.
    pub fn of(time_s: f64, epoch: Epoch) -> Self {
        let date = (epoch == Epoch::Unix)
            .then(|| calendar::rfc3339(time_s))
            .flatten();
        date.map_or_else(|| Self::Seconds(rounded(time_s, 6)), Self::Date)
    }

    /// The date; `None` for seconds.
    pub fn date(&self) -> Option<&str> {
        match self {
            Self::Date(date) => Some(date),
            Self::Seconds(_) => None,
        }
    }
}

impl std::fmt::Display for TimeText {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Date(date) => f.write_str(date),
            Self::Seconds(seconds) => write!(f, "{seconds}"),
        }
    }
}

/// What the search of a frame gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameResult {
    /// A position was found on the map; the filter decides whether it is believed.
    Fix,
    /// No position was found.
    NoFix,
    /// The frame could not be used.
    Unusable,
}

impl FrameResult {
    /// `fix` and so on, as JSON has it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Fix => "fix",
            Self::NoFix => "no_fix",
            Self::Unusable => "unusable",
        }
    }
}

/// What is stated of a frame besides the track.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameNote {
    /// The photo as given.
    pub photo: String,
    /// What its search gave.
    pub frame: FrameResult,
    /// Why there is no fix.
    pub reason: Option<String>,
    /// Wall time of search and filter, without decoding, milliseconds.
    pub time_ms: f64,
}

impl FrameNote {
    /// Of a frame that was searched.
    pub fn of(photo: &str, answer: &FrameAnswer) -> Self {
        let (frame, reason) = match &answer.outcome {
            Ok(Outcome::Fix(_)) => (FrameResult::Fix, None),
            Ok(Outcome::NoFix(no_fix)) => (FrameResult::NoFix, Some(no_fix.to_string())),
            Err(error) => (FrameResult::Unusable, Some(error.to_string())),
        };
        Self {
            photo: photo.to_owned(),
            frame,
            reason,
            time_ms: rounded(answer.time_ms.total, 3),
        }
    }

    /// Of a frame that could not be read.
    pub fn unusable(photo: &str, error: &anyhow::Error) -> Self {
        Self {
            photo: photo.to_owned(),
            frame: FrameResult::Unusable,
            reason: Some(errors::message_with_hint(error)),
            time_ms: 0.0,
        }
    }
}

/// One instant of the track. The position is `null` in every state but `tracking` and `coasting`: it may not be used then.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackLine {
    /// RFC 3339 where the frames' times are dates, else seconds.
    pub time: TimeText,
    /// `searching`, `tracking`, `coasting`, `ambiguous` or `lost`.
    pub state: TrackState,
    /// Latitude, degrees, WGS 84.
    pub lat_deg: Option<f64>,
    /// Longitude, degrees, WGS 84.
    pub lon_deg: Option<f64>,
    /// Heading of the camera's frame, degrees clockwise from true north.
    pub heading_deg: Option<f64>,
    /// Radius in metres that should hold the truth in 95 % of cases.
    pub radius95_m: Option<f64>,
    /// Covariance in square metres: east-east, east-north, north-north.
    pub covariance_en_m2: Option<[f64; 3]>,
    /// Seconds since the last fix that was believed.
    pub age_of_last_fix_s: Option<f64>,
    /// Metres per second to the east.
    pub velocity_east_m_s: Option<f64>,
    /// Metres per second to the north.
    pub velocity_north_m_s: Option<f64>,
    /// Height above ground, metres.
    pub height_agl_m: Option<f64>,
    /// Altitude above mean sea level, metres.
    pub altitude_amsl_m: Option<f64>,
    /// Whether the position is that of the aircraft (`aircraft`), of the aircraft without knowing the camera's tilt
    /// (`aircraft_without_attitude`) or of the ground at the photo's centre (`image_centre`).
    pub position_of: Option<PositionOf>,
    /// What the position rests on: `fix`, `velocity`, `motion` or `prediction`.
    pub source: Option<Source>,
    /// What the frame gave, if the instant is that of a frame.
    #[serde(flatten)]
    pub note: Option<FrameNote>,
}

impl TrackLine {
    /// The track at a time; `point` is `None` where it is not known any more.
    pub fn new(
        time_s: f64,
        epoch: Epoch,
        point: Option<&TrackPoint>,
        note: Option<FrameNote>,
    ) -> Self {
        let state = point.map_or(TrackState::Searching, |point| point.state);
        let estimate = point
            .filter(|point| point.state.is_usable())
            .and_then(|point| point.estimate.as_ref());
        let number = |value: Option<f64>, decimals: i32| value.map(|v| rounded(v, decimals));
        let age_s = point
            .and_then(|point| point.estimate.as_ref())
            .and_then(|estimate| estimate.age_of_last_fix_s);
        Self {
            time: TimeText::of(time_s, epoch),
            state,
            lat_deg: number(estimate.map(|e| e.lat_deg), 8),
            lon_deg: number(estimate.map(|e| e.lon_deg), 8),
            heading_deg: estimate
                .and_then(|e| e.heading_deg)
                .map(|degrees| rounded_heading(degrees, 2)),
            radius95_m: number(estimate.map(|e| e.radius95_m), 3),
            covariance_en_m2: estimate.map(|e| e.covariance_en_m2.map(|v| rounded(v, 6))),
            age_of_last_fix_s: number(age_s, 3),
            velocity_east_m_s: number(estimate.map(|e| e.velocity_east_m_s), 3),
            velocity_north_m_s: number(estimate.map(|e| e.velocity_north_m_s), 3),
            height_agl_m: number(estimate.and_then(|e| e.height_agl_m), 2),
            altitude_amsl_m: number(estimate.and_then(|e| e.altitude_amsl_m), 2),
            position_of: estimate.map(|e| e.position_of),
            source: estimate.map(|e| e.source),
            note,
        }
    }

    /// Longitude and latitude, degrees.
    pub fn lon_lat_deg(&self) -> Option<[f64; 2]> {
        Some([self.lon_deg?, self.lat_deg?])
    }

    /// The position for formats that write positions alone; `None` where it may not be used.
    pub fn place(&self) -> Option<TrackPlace<'_>> {
        let [lon_deg, lat_deg] = self.lon_lat_deg()?;
        Some(TrackPlace {
            lon_deg,
            lat_deg,
            altitude_amsl_m: self.altitude_amsl_m,
            time: self.time.date(),
        })
    }

    /// The photo, or nothing.
    pub fn photo(&self) -> &str {
        self.note.as_ref().map_or("", |note| &note.photo)
    }
}

/// `tracking` and so on, as JSON has it.
pub fn state_text(state: TrackState) -> &'static str {
    match state {
        TrackState::Tracking => "tracking",
        TrackState::Coasting => "coasting",
        TrackState::Ambiguous => "ambiguous",
        TrackState::Lost => "lost",
        _ => "searching",
    }
}

/// `aircraft` and so on, as JSON has it.
pub fn position_of_text(position_of: PositionOf) -> &'static str {
    match position_of {
        PositionOf::Aircraft => "aircraft",
        PositionOf::AircraftWithoutAttitude => "aircraft_without_attitude",
        _ => "image_centre",
    }
}
