//! A georeference from two corners, linear in longitude and latitude (as in the paper).

use serde::{Deserialize, Serialize};

use crate::metres::metres_per_radian;
use crate::{Affine, GeoError, LonLat};

/// Ratio of the sides of a pixel on the ground above which corners or axes may be swapped.
pub(crate) const ODD_ASPECT: f64 = 1.6;
/// Ratio of the sides of a pixel on the ground below which it counts as square.
pub(crate) const SQUARE_ASPECT: f64 = 1.15;
/// Ratio of the sides of a pixel in degrees below which it counts as square.
pub(crate) const SQUARE_IN_DEGREES: f64 = 1.05;

/// The edges of a picture, degrees. If it crosses the antimeridian, `east_deg` exceeds 180.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Corners {
    /// Longitude of the left edge.
    pub west_deg: f64,
    /// Latitude of the lower edge.
    pub south_deg: f64,
    /// Longitude of the right edge.
    pub east_deg: f64,
    /// Latitude of the upper edge.
    pub north_deg: f64,
}

impl Corners {
    /// From the lower left and the upper right corner of a picture of `size_px`. `location` names
    /// the option or file and line, `order` the order in which the numbers are expected there.
    ///
    /// # Errors
    /// [`GeoError::SwappedLonLat`] if longitude and latitude have changed places: a latitude beyond
    /// 90 degrees, or pixels that are far from square on the ground as given, square when
    /// swapped, and not square in degrees. [`GeoError::BadCorners`] if the corners do not span a picture.
    pub fn new(
        lower_left: LonLat,
        upper_right: LonLat,
        size_px: (u64, u64),
        location: &str,
        order: &'static str,
    ) -> Result<Self, GeoError> {
        let bad = |reason: String| GeoError::BadCorners {
            location: location.to_string(),
            reason,
        };
        let swapped = |reason: String| GeoError::SwappedLonLat {
            location: location.to_string(),
            reason,
            order,
        };
        let (ll, ur) = (lower_left, upper_right);
        let all = [ll.lon_deg, ll.lat_deg, ur.lon_deg, ur.lat_deg];
        if all.iter().any(|v| !v.is_finite()) {
            return Err(bad("a number is missing or not finite".to_string()));
        }
        let beyond = |v: f64, limit: f64| v.abs() > limit;
        if beyond(ll.lat_deg, 90.0) || beyond(ur.lat_deg, 90.0) {
            let lat = if beyond(ll.lat_deg, 90.0) {
                ll.lat_deg
            } else {
                ur.lat_deg
            };
            let could_be_swapped =
                !beyond(lat, 180.0) && !beyond(ll.lon_deg, 90.0) && !beyond(ur.lon_deg, 90.0);
            let reason = format!("{lat} is not a latitude");
            return Err(if could_be_swapped {
                swapped(reason)
            } else {
                bad(reason)
            });
        }
        if beyond(ll.lon_deg, 360.0) || beyond(ur.lon_deg, 360.0) {
            return Err(bad("a longitude lies beyond 360 degrees".to_string()));
        }
        let mut east_deg = ur.lon_deg;
        if east_deg < ll.lon_deg && ll.lon_deg - east_deg > 180.0 {
            east_deg += 360.0;
        }
        if east_deg <= ll.lon_deg {
            return Err(bad(format!(
                "the right edge ({}) is not east of the left edge ({})",
                ur.lon_deg, ll.lon_deg
            )));
        }
        if ur.lat_deg <= ll.lat_deg {
            return Err(bad(format!(
                "the upper edge ({}) is not north of the lower edge ({})",
                ur.lat_deg, ll.lat_deg
            )));
        }
        let corners = Self {
            west_deg: ll.lon_deg,
            south_deg: ll.lat_deg,
            east_deg,
            north_deg: ur.lat_deg,
        };
        if let Some((given, other)) = corners.swap_reveals(size_px) {
            return Err(swapped(format!(
                "pixels would be {given:.2} times as wide as high on the ground, swapped {other:.2}"
            )));
        }
        Ok(corners)
    }

    /// The transform from pixels of a picture of `size_px` to longitude and latitude.
    ///
    /// # Errors
    /// [`GeoError::SingularTransform`] if the picture has no pixels or the corners are too near each other.
    pub fn affine(&self, size_px: (u64, u64)) -> Result<Affine, GeoError> {
        let (width_deg, height_deg) = self.pixel_size_deg(size_px);
        Affine::from_gdal([
            self.west_deg,
            width_deg,
            0.0,
            self.north_deg,
            0.0,
            -height_deg,
        ])
    }

    /// Degrees of longitude and of latitude per pixel of a picture of `size_px`.
    pub(crate) fn pixel_size_deg(&self, size_px: (u64, u64)) -> (f64, f64) {
        (
            (self.east_deg - self.west_deg) / size_px.0 as f64,
            (self.north_deg - self.south_deg) / size_px.1 as f64,
        )
    }

    /// Width over height of a pixel on the ground as given and with longitude and latitude swapped, if these show that
    /// they are swapped.
    fn swap_reveals(&self, size_px: (u64, u64)) -> Option<(f64, f64)> {
        let aspect = |lon_span: f64, lat_span: f64, lat: f64| {
            let (east_m, north_m) = metres_per_radian(lat);
            (lon_span * east_m / size_px.0 as f64) / (lat_span * north_m / size_px.1 as f64)
        };
        let (lon_span, lat_span) = (
            self.east_deg - self.west_deg,
            self.north_deg - self.south_deg,
        );
        let given = aspect(lon_span, lat_span, 0.5 * (self.south_deg + self.north_deg));
        let middle_lon = 0.5 * (self.west_deg + self.east_deg);
        if middle_lon.abs() > 89.0 {
            return None;
        }
        let other = aspect(lat_span, lon_span, middle_lon);
        let off = |a: f64| a.max(1.0 / a);
        let (width_deg, height_deg) = self.pixel_size_deg(size_px);
        // Pixels that are square in degrees are usual, and tell nothing.
        if off(width_deg / height_deg) < SQUARE_IN_DEGREES {
            return None;
        }
        (off(given) > ODD_ASPECT && off(other) < SQUARE_ASPECT).then_some((given, other))
    }
}
