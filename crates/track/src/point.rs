//! What the filter gives out.

use nalgebra::Vector2;
use serde::Serialize;

use crate::{
    filter::Filter, hypothesis::PositionOf, options::TrackOptions, radius::radius95_m,
    reference::ReferenceKind,
};

/// How much the position is to be believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum TrackState {
    /// Nothing was believed yet.
    Searching,
    /// Fixes support the position.
    Tracking,
    /// No recent fix; the position is carried on with a growing covariance.
    Coasting,
    /// Two or more places are possible.
    Ambiguous,
    /// The position was known once and became too uncertain.
    Lost,
}

impl TrackState {
    /// Whether the position may be used, for instance sent to an autopilot.
    pub fn is_usable(self) -> bool {
        matches!(self, Self::Tracking | Self::Coasting)
    }
}

/// What the position at a time rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Source {
    /// A fix at this very time.
    Fix,
    /// The last fix and the autopilot's velocity.
    Velocity,
    /// The last fix and motion between frames.
    Motion,
    /// The last fix and the velocity that the filter estimated.
    Prediction,
}

/// The track at one time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrackPoint {
    /// Seconds on the inputs' clock.
    pub time_s: f64,
    /// How much to believe it.
    pub state: TrackState,
    /// The leading hypothesis. `None` if there is none. Check [`TrackState::is_usable`] before it is used.
    #[serde(flatten)]
    pub estimate: Option<Estimate>,
}

/// Position, velocity and heading with their uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// Degrees north.
    pub lat_deg: f64,
    /// Degrees east.
    pub lon_deg: f64,
    /// Metres above mean sea level, as the latest [`crate::Height`] gave it. `None` if unknown, or longer ago than
    /// [`crate::Height::HOLD_S`].
    pub altitude_amsl_m: Option<f64>,
    /// Metres above ground, likewise.
    pub height_agl_m: Option<f64>,
    /// Metres per second to the east.
    pub velocity_east_m_s: f64,
    /// Metres per second to the north.
    pub velocity_north_m_s: f64,
    /// Standard deviation of the velocity per axis (root mean square of the two), metres per second.
    pub velocity_sigma_m_s: f64,
    /// Heading of the camera's frame, degrees clockwise from true north. `None` if unknown.
    pub heading_deg: Option<f64>,
    /// Its standard deviation, degrees.
    pub heading_sigma_deg: Option<f64>,
    /// 1-sigma covariance of the position, square metres: east-east, east-north, north-north. It includes the map's error.
    pub covariance_en_m2: [f64; 3],
    /// The position is within this distance with 95 % probability, metres.
    pub radius95_m: f64,
    /// Time since the last fix that was accepted. `None` if there was none.
    pub age_of_last_fix_s: Option<f64>,
    /// Distance flown since then, metres.
    pub distance_since_fix_m: f64,
    /// Squared Mahalanobis distance of the last fix over the gate: below 1 accepted, below 0.5 good.
    pub test_ratio: f64,
    /// Weight of the leading hypothesis and of those of the same place together, 0 to 1.
    pub weight: f64,
    /// What the position rests on.
    pub source: Source,
    /// What point it is the position of.
    pub position_of: PositionOf,
}

impl Estimate {
    /// Whether it is at the time of a fix that was accepted.
    #[must_use]
    pub fn is_at_fix(&self) -> bool {
        self.age_of_last_fix_s == Some(0.0)
    }
}

impl TrackPoint {
    /// The track at `time_s`, which is not before the latest input of `filter`.
    pub(crate) fn of(filter: &Filter, time_s: f64, options: &TrackOptions) -> Self {
        let nothing = Self {
            time_s,
            state: if filter.was_believed {
                TrackState::Lost
            } else {
                TrackState::Searching
            },
            estimate: None,
        };
        let mut ahead = filter.bank.clone();
        ahead.propagate(time_s, options);
        let Some(at) = ahead.leading_place() else {
            return nothing;
        };
        let (leader, weight, covariance_m2) = (at.leader, at.weight, at.covariance_m2);
        let Some(place) = filter.lonlat_from_en(at.position_m) else {
            return nothing;
        };
        let radius_m = radius95_m(&covariance_m2);
        let age_s = leader.last_fix_s.map(|fix_s| time_s - fix_s);
        let state = if filter.believed.is_none() {
            nothing.state
        } else if radius_m > options.lost_radius_m {
            TrackState::Lost
        } else if !filter.believes(&at, options) {
            TrackState::Ambiguous
        } else if age_s.is_none_or(|age_s| age_s > options.coasting_after_s) {
            TrackState::Coasting
        } else {
            TrackState::Tracking
        };
        let velocity: Vector2<f64> = leader.velocity_m_s();
        let heading = leader.heading_at(time_s);
        let source = match (age_s, leader.reference_kind(options)) {
            (Some(age_s), _) if age_s <= 0.0 => Source::Fix,
            (_, ReferenceKind::Velocity) => Source::Velocity,
            (_, ReferenceKind::Motion) => Source::Motion,
            (_, ReferenceKind::Free) => Source::Prediction,
        };
        let estimate = Estimate {
            lat_deg: place.lat_deg,
            lon_deg: place.lon_deg,
            altitude_amsl_m: filter.sensors.amsl_m(time_s),
            height_agl_m: filter.sensors.agl_m(time_s),
            velocity_east_m_s: velocity.x,
            velocity_north_m_s: velocity.y,
            velocity_sigma_m_s: (0.5 * leader.velocity_covariance_m2_s2().trace())
                .max(0.0)
                .sqrt(),
            heading_deg: heading.map(|heading| heading.heading_deg),
            heading_sigma_deg: heading.map(|heading| heading.sigma_deg()),
            covariance_en_m2: [
                covariance_m2[(0, 0)],
                covariance_m2[(0, 1)],
                covariance_m2[(1, 1)],
            ],
            radius95_m: radius_m,
            age_of_last_fix_s: age_s,
            distance_since_fix_m: leader.distance_since_fix_m,
            test_ratio: leader.test_ratio,
            weight,
            source,
            position_of: leader.position_of(),
        };
        Self {
            time_s,
            state,
            estimate: Some(estimate),
        }
    }
}
