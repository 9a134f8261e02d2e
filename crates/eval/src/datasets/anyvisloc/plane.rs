//! The local plane of a scene on the ellipsoid.

use grimnet_geo::{LonLat, destination_en_m};

/// Where the origin of the plane is placed.
const ORIGIN: LonLat = LonLat {
    lon_deg: 0.0,
    lat_deg: 0.0,
};

/// Longitude and latitude of a point of the plane, given in metres to the east and to the south.
pub(super) fn lonlat(x_m: f64, y_m: f64) -> LonLat {
    destination_en_m(ORIGIN, x_m, -y_m)
}
