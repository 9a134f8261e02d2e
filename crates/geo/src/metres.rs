//! Longitude, latitude and metres on the WGS 84 ellipsoid.
//!
//! Geodesics after C. F. F. Karney, "Algorithms for geodesics", J. Geodesy 87 (2013), through
//! `geographiclib-rs`; errors of the distances are below a micrometre.

use geographiclib_rs::{DirectGeodesic, Geodesic, InverseGeodesic};
use serde::{Deserialize, Serialize};

/// Semi-major axis of WGS 84, metres (EPSG:7030).
pub(crate) const WGS84_A_M: f64 = 6_378_137.0;
/// Flattening of WGS 84 (EPSG:7030).
pub(crate) const WGS84_F: f64 = 1.0 / 298.257_223_563;

/// A position in degrees of longitude and latitude on WGS 84.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LonLat {
    /// Degrees east of Greenwich.
    pub lon_deg: f64,
    /// Degrees north of the equator.
    pub lat_deg: f64,
}

impl LonLat {
    /// The position at `lon_deg` east and `lat_deg` north.
    pub const fn new(lon_deg: f64, lat_deg: f64) -> Self {
        Self { lon_deg, lat_deg }
    }

    /// Whether both are finite and the latitude lies in `[-90, 90]`.
    pub fn is_valid(&self) -> bool {
        self.lon_deg.is_finite() && self.lat_deg.is_finite() && self.lat_deg.abs() <= 90.0
    }
}

/// The same longitude in `[-180, 180)`. NaN and infinities give NaN.
///
/// ```
/// assert_eq!(grimnet_geo::wrap_longitude_deg(181.5), -178.5);
/// assert_eq!(grimnet_geo::wrap_longitude_deg(-180.0), -180.0);
/// assert_eq!(grimnet_geo::wrap_longitude_deg(120.72), 120.72);
/// ```
pub fn wrap_longitude_deg(lon_deg: f64) -> f64 {
    if (-180.0..180.0).contains(&lon_deg) {
        return lon_deg;
    }
    // `rem_euclid` may round up to the modulus itself.
    let turned = (lon_deg + 180.0).rem_euclid(360.0);
    if turned >= 360.0 {
        -180.0
    } else {
        turned - 180.0
    }
}

/// Length of the geodesic between two positions, metres.
///
/// ```
/// use grimnet_geo::{LonLat, distance_m};
/// // One degree of longitude on the equator: a * pi / 180.
/// let metres = distance_m(LonLat::new(0.0, 0.0), LonLat::new(1.0, 0.0));
/// assert!((metres - 111_319.490_793).abs() < 1e-6);
/// ```
pub fn distance_m(from: LonLat, to: LonLat) -> f64 {
    Geodesic::wgs84().inverse(from.lat_deg, from.lon_deg, to.lat_deg, to.lon_deg)
}

/// Bearing of the geodesic at `from`, degrees clockwise from true north in `[0, 360)`.
pub fn bearing_deg(from: LonLat, to: LonLat) -> f64 {
    let (_m, azimuth_deg, _) = length_and_azimuths(from, to);
    azimuth_deg.rem_euclid(360.0)
}

/// Metres east and north from one position to another: the length of the geodesic, split by its bearing at `from`.
///
/// Meant for distances within a map.
pub fn offset_en_m(from: LonLat, to: LonLat) -> (f64, f64) {
    let (length_m, azimuth_deg, _) = length_and_azimuths(from, to);
    let (sin, cos) = azimuth_deg.to_radians().sin_cos();
    (length_m * sin, length_m * cos)
}

/// The position at `length_m` metres from `from` along the geodesic that starts at `bearing_deg` degrees clockwise
/// from true north.
pub fn destination(from: LonLat, bearing_deg: f64, length_m: f64) -> LonLat {
    let (lat_deg, lon_deg) =
        Geodesic::wgs84().direct(from.lat_deg, from.lon_deg, bearing_deg, length_m);
    LonLat::new(wrap_longitude_deg(lon_deg), lat_deg)
}

/// The position `east_m` metres east and `north_m` metres north of `from`: the inverse of [`offset_en_m`].
pub fn destination_en_m(from: LonLat, east_m: f64, north_m: f64) -> LonLat {
    destination(
        from,
        east_m.atan2(north_m).to_degrees(),
        east_m.hypot(north_m),
    )
}

/// Metres per radian of longitude and of latitude at a latitude: the radius of the parallel and
/// the meridional radius of curvature (Snyder 1987, equations 4-19 to 4-21).
pub(crate) fn metres_per_radian(lat_deg: f64) -> (f64, f64) {
    let e2 = WGS84_F * (2.0 - WGS84_F);
    let (sin, cos) = lat_deg.to_radians().sin_cos();
    let w2 = 1.0 - e2 * sin * sin;
    (
        WGS84_A_M * cos / w2.sqrt(),
        WGS84_A_M * (1.0 - e2) / (w2 * w2.sqrt()),
    )
}

fn length_and_azimuths(from: LonLat, to: LonLat) -> (f64, f64, f64) {
    let (length_m, azimuth_from_deg, azimuth_to_deg, _arc_deg): (f64, f64, f64, f64) =
        Geodesic::wgs84().inverse(from.lat_deg, from.lon_deg, to.lat_deg, to.lon_deg);
    (length_m, azimuth_from_deg, azimuth_to_deg)
}
