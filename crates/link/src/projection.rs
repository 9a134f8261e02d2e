//! Latitude and longitude in the local metres of an autopilot.
//!
//! An autopilot turns metres that it is sent into latitude and longitude by its own formula, on a sphere. Metres on the
//! ellipsoid would put the aircraft 10 m off at 2 km from the origin; so the same formula is used here, backwards.

use grimnet_geo::wrap_longitude_deg;

use crate::autopilot::AutopilotKind;

/// Metres per degree of ArduPilot (`LATLON_TO_M` in AP_Common/Location.h, per 1e-7 degree).
const ARDUPILOT_METRES_PER_DEG: f64 = 0.011_131_884_502_145_034 * 1e7;
/// Radius of PX4's sphere, metres (`CONSTANTS_RADIUS_OF_EARTH` in lib/geo).
const PX4_RADIUS_M: f64 = 6_371_000.0;

/// The origin of an autopilot's local frame and its way to compute with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Projection {
    pub lat_deg: f64,
    pub lon_deg: f64,
    pub kind: AutopilotKind,
}

impl Projection {
    /// Metres north and east of the origin.
    pub fn north_east_m(&self, lat_deg: f64, lon_deg: f64) -> (f64, f64) {
        let d_lon_deg = wrap_longitude_deg(lon_deg - self.lon_deg);
        match self.kind {
            AutopilotKind::ArduPilot => {
                // Location::get_distance_NE: the scale of longitude is that of the mean latitude.
                let scale = (0.5 * (lat_deg + self.lat_deg))
                    .to_radians()
                    .cos()
                    .max(0.01);
                (
                    (lat_deg - self.lat_deg) * ARDUPILOT_METRES_PER_DEG,
                    d_lon_deg * ARDUPILOT_METRES_PER_DEG * scale,
                )
            }
            // MapProjection::project: azimuthal equidistant.
            AutopilotKind::Px4 | AutopilotKind::Other => {
                let (lat, lat_0) = (lat_deg.to_radians(), self.lat_deg.to_radians());
                let d_lon = d_lon_deg.to_radians();
                let cos_c = lat_0.sin() * lat.sin() + lat_0.cos() * lat.cos() * d_lon.cos();
                let c = cos_c.clamp(-1.0, 1.0).acos();
                let k = if c > 0.0 { c / c.sin() } else { 1.0 };
                (
                    k * (lat_0.cos() * lat.sin() - lat_0.sin() * lat.cos() * d_lon.cos())
                        * PX4_RADIUS_M,
                    k * lat.cos() * d_lon.sin() * PX4_RADIUS_M,
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where ArduPilot believes to be (Location::offset_latlng).
    fn ardupilot_lat_lon(from: &Projection, north_m: f64, east_m: f64) -> (f64, f64) {
        let d_lat = north_m / ARDUPILOT_METRES_PER_DEG;
        let scale = (from.lat_deg + 0.5 * d_lat).to_radians().cos();
        (
            from.lat_deg + d_lat,
            from.lon_deg + east_m / ARDUPILOT_METRES_PER_DEG / scale,
        )
    }

    /// Where PX4 believes to be (MapProjection::reproject).
    fn px4_lat_lon(from: &Projection, north_m: f64, east_m: f64) -> (f64, f64) {
        let (x, y) = (north_m / PX4_RADIUS_M, east_m / PX4_RADIUS_M);
        let c = x.hypot(y);
        let (sin, cos) = from.lat_deg.to_radians().sin_cos();
        let lat = (c.cos() * sin + x * c.sin() * cos / c).asin();
        let lon = (y * c.sin()).atan2(c * cos * c.cos() - x * sin * c.sin());
        (lat.to_degrees(), from.lon_deg + lon.to_degrees())
    }

    #[test]
    fn the_autopilot_ends_where_it_was_told() {
        let places = [(24.15, 120.68), (-33.9, 151.2), (60.0, 179.98), (0.0, 0.0)];
        for (lat_deg, lon_deg) in places {
            for kind in [AutopilotKind::ArduPilot, AutopilotKind::Px4] {
                let projection = Projection {
                    lat_deg,
                    lon_deg,
                    kind,
                };
                for (d_lat, d_lon) in [(0.02, 0.03), (-0.05, 0.01), (0.001, -0.04)] {
                    let target = (lat_deg + d_lat, lon_deg + d_lon);
                    let wrapped = wrap_longitude_deg(target.1);
                    let (north_m, east_m) = projection.north_east_m(target.0, wrapped);
                    let (lat, lon) = match kind {
                        AutopilotKind::ArduPilot => ardupilot_lat_lon(&projection, north_m, east_m),
                        _ => px4_lat_lon(&projection, north_m, east_m),
                    };
                    assert!((lat - target.0).abs() < 1e-9, "{kind:?} {lat} {target:?}");
                    assert!((lon - target.1).abs() < 1e-9, "{kind:?} {lon} {target:?}");
                }
                assert_eq!(projection.north_east_m(lat_deg, lon_deg), (0.0, 0.0));
            }
        }
    }
}
