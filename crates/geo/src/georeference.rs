//! From map pixels to longitude and latitude, and back.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::{Affine, Crs, GeoError, LonLat, MapPx, offset_en_m, wrap_longitude_deg};

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

    /// West, south, east and north of the map, degrees, from its corners; all longitudes if a pole lies on it. East is above 180 on a
    /// map that crosses the antimeridian.
    ///
    /// # Errors
    /// As [`Georeference::lonlat_from_map_px`].
    pub fn bounds_deg(&self) -> Result<[f64; 4], GeoError> {
        let (width, height) = (2.0 * self.centre_px.x, 2.0 * self.centre_px.y);
        let centre_deg = self.lonlat_from_map_px(self.centre_px)?.lon_deg;
        let mut bounds = [
            f64::INFINITY,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NEG_INFINITY,
        ];
        let mut include = |lon_deg: f64, lat_deg: f64| {
            let [west, south, east, north] = &mut bounds;
            (*west, *east) = (west.min(lon_deg), east.max(lon_deg));
            (*south, *north) = (south.min(lat_deg), north.max(lat_deg));
        };
        for (x, y) in [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)] {
            let corner = self.lonlat_from_map_px(MapPx::new(x, y))?;
            // On the centre's side of the antimeridian.
            include(
                centre_deg + wrap_longitude_deg(corner.lon_deg - centre_deg),
                corner.lat_deg,
            );
        }
        let mut has_pole = false;
        for lat_deg in [-90.0, 90.0] {
            // Most projections have no pixel for a pole.
            let pole = self.map_px_from_lonlat(LonLat::new(centre_deg, lat_deg));
            if pole.is_ok_and(|p| 0.0 < p.x && p.x < width && 0.0 < p.y && p.y < height) {
                include(centre_deg, lat_deg);
                has_pole = true;
            }
        }
        let [west, south, east, north] = bounds;
        if has_pole {
            return Ok([-180.0, south, 180.0, north]);
        }
        let turn = if west < -180.0 { 360.0 } else { 0.0 };
        Ok([west + turn, south, east + turn, north])
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
    /// Central differences over 128 px, of metres along geodesics from the point: longitudes say nothing near a pole.
    ///
    /// # Errors
    /// As [`Georeference::lonlat_from_map_px`].
    pub fn east_north_m_from_map_px_jacobian(
        &self,
        place: MapPx,
    ) -> Result<Matrix2<f64>, GeoError> {
        let at = self.lonlat_from_map_px(place)?;
        let offset_m = |dx: f64, dy: f64| -> Result<Vector2<f64>, GeoError> {
            let there = self.lonlat_from_map_px(MapPx::new(place.x + dx, place.y + dy))?;
            let (east_m, north_m) = offset_en_m(at, there);
            Ok(Vector2::new(east_m, north_m))
        };
        let step = JACOBIAN_STEP_PX;
        let along_x = offset_m(step, 0.0)? - offset_m(-step, 0.0)?;
        let along_y = offset_m(0.0, step)? - offset_m(0.0, -step)?;
        Ok(Matrix2::from_columns(&[along_x, along_y]) / (2.0 * step))
    }
}
