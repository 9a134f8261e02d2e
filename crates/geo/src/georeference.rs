//! From map pixels to longitude and latitude, and back.

use nalgebra::Matrix2;
use serde::{Deserialize, Serialize};

use crate::metres::{metres_per_radian, wrap_longitude_deg};
use crate::{Affine, Crs, GeoError, LonLat, MapPx};

/// Half the step of the central differences of the Jacobian, pixels.
const JACOBIAN_STEP_PX: f64 = 64.0;

/// The georeference of a map: an affine transform from pixels to the coordinates of a CRS, and the CRS.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Georeference {
    affine: Affine,
    crs: Crs,
    /// The map's centre. Coordinates that repeat around the world are taken nearest to it.
    #[serde(rename = "center_px")]
    centre_px: MapPx,
}

impl Georeference {
    /// A georeference for a map of `size_px` (width, height).
    pub fn new(affine: Affine, crs: Crs, size_px: (u64, u64)) -> Self {
        let centre_px = MapPx::new(size_px.0 as f64 / 2.0, size_px.1 as f64 / 2.0);
        Self {
            affine,
            crs,
            centre_px,
        }
    }

    /// The transform from map pixels to the CRS.
    pub fn affine(&self) -> &Affine {
        &self.affine
    }

    /// The coordinate system.
    pub fn crs(&self) -> &Crs {
        &self.crs
    }

    /// The map's centre, pixels.
    pub fn centre_px(&self) -> MapPx {
        self.centre_px
    }

    /// Longitude and latitude of a map pixel. Longitudes are in `[-180, 180)`, also on a map that
    /// crosses the antimeridian.
    ///
    /// # Errors
    /// Returns [`GeoError::OutsideDomain`] outside the domain of the projection.
    pub fn lonlat_from_map_px(&self, place: MapPx) -> Result<LonLat, GeoError> {
        let (x, y) = self.affine.xy_from_map_px(place);
        self.crs.lonlat_from_xy(x, y)
    }

    /// Map pixel of a longitude and latitude; it lies outside the map if the position does. On a map
    /// that crosses the antimeridian the position is taken on the side nearer to the map's centre.
    ///
    /// # Errors
    /// Returns [`GeoError::OutsideDomain`] outside the domain of the projection.
    pub fn map_px_from_lonlat(&self, place: LonLat) -> Result<MapPx, GeoError> {
        let (mut x, y) = self.crs.xy_from_lonlat(place)?;
        if let Some(period) = self.crs.period_x() {
            let (centre_x, _) = self.affine.xy_from_map_px(self.centre_px);
            x -= ((x - centre_x) / period).round() * period;
        }
        Ok(self.affine.map_px_from_xy(x, y))
    }

    /// Metres on the ground per map pixel: along the map's x, and along its y.
    ///
    /// # Errors
    /// As [`Georeference::lonlat_from_map_px`].
    pub fn ground_resolution_m(&self, place: MapPx) -> Result<(f64, f64), GeoError> {
        let j = self.east_north_m_from_map_px_jacobian(place)?;
        Ok((j[(0, 0)].hypot(j[(1, 0)]), j[(0, 1)].hypot(j[(1, 1)])))
    }

    /// The bearing of the map's upward direction, degrees clockwise from true north in `[0, 360)`:
    /// 0 on a north-up map, plus the meridian convergence of its projection.
    ///
    /// # Errors
    /// As [`Georeference::lonlat_from_map_px`].
    pub fn up_bearing_deg(&self, place: MapPx) -> Result<f64, GeoError> {
        let j = self.east_north_m_from_map_px_jacobian(place)?;
        let degrees = (-j[(0, 1)])
            .atan2(-j[(1, 1)])
            .to_degrees()
            .rem_euclid(360.0);
        // Rounding may give 360.
        Ok(if degrees >= 360.0 { 0.0 } else { degrees })
    }

    /// Metres east (first row) and north (second row) per map pixel to the right (first column)
    /// and down (second column), at a point. North-up: `[[gsd, 0], [0, -gsd]]`.
    ///
    /// Central differences over 128 px, in metres of the ellipsoid's radii of curvature there.
    ///
    /// # Errors
    /// As [`Georeference::lonlat_from_map_px`].
    pub fn east_north_m_from_map_px_jacobian(
        &self,
        place: MapPx,
    ) -> Result<Matrix2<f64>, GeoError> {
        let at = self.lonlat_from_map_px(place)?;
        let (east_m_per_rad, north_m_per_rad) = metres_per_radian(at.lat_deg);
        let difference = |dx: f64, dy: f64| -> Result<(f64, f64), GeoError> {
            let a = self.lonlat_from_map_px(MapPx::new(place.x - dx, place.y - dy))?;
            let b = self.lonlat_from_map_px(MapPx::new(place.x + dx, place.y + dy))?;
            let lon_rad = wrap_longitude_deg(b.lon_deg - a.lon_deg).to_radians();
            let lat_rad = (b.lat_deg - a.lat_deg).to_radians();
            let per_px = 1.0 / (2.0 * JACOBIAN_STEP_PX);
            Ok((
                lon_rad * east_m_per_rad * per_px,
                lat_rad * north_m_per_rad * per_px,
            ))
        };
        let (e_x, n_x) = difference(JACOBIAN_STEP_PX, 0.0)?;
        let (e_y, n_y) = difference(0.0, JACOBIAN_STEP_PX)?;
        Ok(Matrix2::new(e_x, e_y, n_x, n_y))
    }
}
