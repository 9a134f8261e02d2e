//! Position of the world on the globe: its axes are those of a UTM zone.

use proj4rs::Proj;

use crate::error::WorldError;

/// Placement in a UTM zone: `x_m` is easting and `y_m` northing relative to the south-west corner.
#[derive(Debug)]
pub struct Placement {
    zone: u8,
    north: bool,
    origin_m: [f64; 2],
    utm: Proj,
    lonlat: Proj,
}

impl Placement {
    /// Places the south-west corner of the world near a position, at whole metres of its UTM zone.
    ///
    /// # Errors
    /// [`WorldError::Place`] if the position is outside UTM (latitude -80 to 84) or not finite.
    pub fn at(lon_deg: f64, lat_deg: f64) -> Result<Self, WorldError> {
        let fail = |reason: String| WorldError::Place {
            lon_deg,
            lat_deg,
            reason,
        };
        if !(-180.0..180.0).contains(&lon_deg) || !(-80.0..84.0).contains(&lat_deg) {
            return Err(fail(
                "expected -180 <= longitude < 180 and -80 <= latitude < 84, the range of UTM"
                    .into(),
            ));
        }
        let zone = ((lon_deg + 180.0) / 6.0).floor() as u8 + 1;
        let north = lat_deg >= 0.0;
        let south = if north { "" } else { " +south" };
        let utm = Proj::from_proj_string(&format!(
            "+proj=utm +zone={zone}{south} +datum=WGS84 +units=m +no_defs"
        ))
        .map_err(|e| fail(e.to_string()))?;
        let lonlat = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs")
            .map_err(|e| fail(e.to_string()))?;
        let mut point = (lon_deg.to_radians(), lat_deg.to_radians(), 0.0);
        proj4rs::transform::transform(&lonlat, &utm, &mut point)
            .map_err(|e| fail(e.to_string()))?;
        Ok(Self {
            zone,
            north,
            origin_m: [point.0.round(), point.1.round()],
            utm,
            lonlat,
        })
    }

    /// EPSG code of the coordinate system: 32601-32660 north, 32701-32760 south.
    pub fn epsg(&self) -> u16 {
        (if self.north { 32600 } else { 32700 }) + u16::from(self.zone)
    }

    /// Easting and northing of the world's south-west corner, metres.
    pub fn origin_m(&self) -> [f64; 2] {
        self.origin_m
    }

    /// Easting and northing of a world point, metres.
    pub fn utm_from_world(&self, world_m: [f64; 2]) -> [f64; 2] {
        [self.origin_m[0] + world_m[0], self.origin_m[1] + world_m[1]]
    }

    /// Longitude and latitude (WGS 84, degrees) of a world point.
    ///
    /// # Errors
    /// [`WorldError::Place`] if the point is outside the projection.
    pub fn lonlat_from_world(&self, world_m: [f64; 2]) -> Result<[f64; 2], WorldError> {
        let [e, n] = self.utm_from_world(world_m);
        let mut point = (e, n, 0.0);
        proj4rs::transform::transform(&self.utm, &self.lonlat, &mut point).map_err(|e| {
            WorldError::Place {
                lon_deg: f64::NAN,
                lat_deg: f64::NAN,
                reason: e.to_string(),
            }
        })?;
        Ok([point.0.to_degrees(), point.1.to_degrees()])
    }

    /// World point of a longitude and latitude (WGS 84, degrees).
    ///
    /// # Errors
    /// [`WorldError::Place`] if the position is outside the projection.
    pub fn world_from_lonlat(&self, lonlat_deg: [f64; 2]) -> Result<[f64; 2], WorldError> {
        let [lon_deg, lat_deg] = lonlat_deg;
        let mut point = (lon_deg.to_radians(), lat_deg.to_radians(), 0.0);
        proj4rs::transform::transform(&self.lonlat, &self.utm, &mut point).map_err(|e| {
            WorldError::Place {
                lon_deg,
                lat_deg,
                reason: e.to_string(),
            }
        })?;
        Ok([point.0 - self.origin_m[0], point.1 - self.origin_m[1]])
    }

    /// Bearing of grid north, degrees clockwise from true north, at a world point: true heading =
    /// grid heading + this.
    ///
    /// # Errors
    /// As [`Self::lonlat_from_world`].
    pub fn grid_north_deg(&self, world_m: [f64; 2]) -> Result<f64, WorldError> {
        let [lon0, lat0] = self.lonlat_from_world([world_m[0], world_m[1] - 50.0])?;
        let [lon1, lat1] = self.lonlat_from_world([world_m[0], world_m[1] + 50.0])?;
        // WGS 84: ratio of the radii of curvature along the parallel and the meridian.
        const E2: f64 = 0.006_694_379_990_14;
        let (sin, cos) = ((lat0 + lat1) * 0.5).to_radians().sin_cos();
        let east = (lon1 - lon0) * cos;
        let north = (lat1 - lat0) * (1.0 - E2) / (1.0 - E2 * sin * sin);
        Ok(east.atan2(north).to_degrees())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn zone_and_round_trip() {
        let place = Placement::at(13.4, 47.8).unwrap();
        assert_eq!(place.epsg(), 32633);
        let lonlat = place.lonlat_from_world([812.5, 33.25]).unwrap();
        let back = place.world_from_lonlat(lonlat).unwrap();
        assert_relative_eq!(back[0], 812.5, epsilon = 1e-5);
        assert_relative_eq!(back[1], 33.25, epsilon = 1e-5);
        assert_eq!(Placement::at(-71.0, -33.0).unwrap().epsg(), 32719);
        assert!(Placement::at(10.0, 89.0).is_err());
    }

    #[test]
    fn convergence_matches_the_formula() {
        // Meridian convergence is about (lon - lon0) * sin(lat); grid north then lies that far
        // clockwise of true north.
        let place = Placement::at(16.5, 48.0).unwrap();
        let expected = 1.5 * 48.0_f64.to_radians().sin();
        assert_relative_eq!(
            place.grid_north_deg([0.0, 0.0]).unwrap(),
            expected,
            epsilon = 2e-3
        );
    }
}
