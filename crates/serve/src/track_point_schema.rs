//! [`TrackPoint`](grimnet_track::TrackPoint) for the OpenAPI document; a test compares it with what is sent.

/// A track at one time. Without a position the fields after `state` are left out.
#[derive(utoipa::ToSchema)]
#[schema(as = TrackPoint)]
#[allow(dead_code, reason = "describes TrackPoint of grimnet-track")]
pub(crate) struct TrackPointSchema {
    /// Time of the frame, seconds on the clock of the client.
    time_s: f64,
    /// `searching`: no position is relied on yet. `tracking`: fixes support the position. `coasting`: no recent fix, the position is carried on with a
    /// growing covariance. `ambiguous`: several places are possible. `lost`: the position became too uncertain. Only positions of
    /// `tracking` and `coasting` may be used.
    state: String,
    /// Latitude, degrees, WGS 84.
    #[schema(required = false, nullable = false)]
    lat_deg: Option<f64>,
    /// Longitude, degrees, WGS 84.
    #[schema(required = false, nullable = false)]
    lon_deg: Option<f64>,
    /// Altitude above mean sea level, metres; `null` if unknown.
    #[schema(required = false)]
    altitude_amsl_m: Option<f64>,
    /// Height above ground, metres; `null` if unknown.
    #[schema(required = false)]
    height_agl_m: Option<f64>,
    /// Velocity to the east, metres per second.
    #[schema(required = false, nullable = false)]
    velocity_east_m_s: Option<f64>,
    /// Velocity to the north, metres per second.
    #[schema(required = false, nullable = false)]
    velocity_north_m_s: Option<f64>,
    /// Standard deviation of the velocity for each axis, metres per second.
    #[schema(required = false, nullable = false)]
    velocity_sigma_m_s: Option<f64>,
    /// Direction of the photo's top edge, degrees clockwise from true north; `null` if unknown.
    #[schema(required = false)]
    heading_deg: Option<f64>,
    /// Standard deviation of the heading, degrees; `null` if the heading is unknown.
    #[schema(required = false)]
    heading_sigma_deg: Option<f64>,
    /// Covariance of the position (1 sigma), square metres: east-east, east-north, north-north. It includes the map's error.
    #[schema(required = false, nullable = false)]
    covariance_en_m2: Option<[f64; 3]>,
    /// Radius in metres that holds the true position with 95 % probability.
    #[schema(required = false, nullable = false)]
    radius95_m: Option<f64>,
    /// Time since the last fix that was accepted, seconds; `null` if there was none.
    #[schema(required = false)]
    age_of_last_fix_s: Option<f64>,
    /// Distance flown since that fix, metres.
    #[schema(required = false, nullable = false)]
    distance_since_fix_m: Option<f64>,
    /// Squared Mahalanobis distance of the last fix over the gate, without unit: below 1 accepted, below 0.5 good.
    #[schema(required = false, nullable = false)]
    test_ratio: Option<f64>,
    /// Weight of the leading hypothesis and of those of the same place together, 0 to 1.
    #[schema(required = false, nullable = false)]
    weight: Option<f64>,
    /// What the position rests on: `fix` (at this very time), or the last fix and `velocity` (the autopilot's), `motion` (between
    /// frames) or `prediction` (the velocity that the filter estimated).
    #[schema(required = false, nullable = false)]
    source: Option<String>,
    /// Which point it is the position of: `aircraft`, `aircraft_without_attitude` (the camera's unknown tilt is part of the covariance) or
    /// `image_centre` (the ground at the photo's centre).
    #[schema(required = false, nullable = false)]
    position_of: Option<String>,
}
