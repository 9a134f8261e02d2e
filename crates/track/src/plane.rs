//! A local plane of metres east and north.

use grimnet_geo::{LonLat, destination_en_m, offset_en_m};
use nalgebra::{Rotation2, Vector2};

/// Metres east and north of an origin, along geodesics from it (azimuthal equidistant). Within 20 km the scale is right to 2
/// parts in a million.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LocalPlane {
    origin: LonLat,
}

/// The plane is moved when the aircraft is this far from its origin, metres.
const REANCHOR_M: f64 = 20_000.0;

impl LocalPlane {
    pub fn new(origin: LonLat) -> Self {
        Self { origin }
    }

    pub fn en_from_lonlat(&self, place: LonLat) -> Vector2<f64> {
        let (east_m, north_m) = offset_en_m(self.origin, place);
        Vector2::new(east_m, north_m)
    }

    pub fn lonlat_from_en(&self, en_m: Vector2<f64>) -> LonLat {
        destination_en_m(self.origin, en_m.x, en_m.y)
    }

    /// The plane around a place given in this one, if that is so far from the origin that the plane is moved.
    pub fn moved_to(&self, en_m: Vector2<f64>) -> Option<Self> {
        (en_m.norm() >= REANCHOR_M).then(|| Self::new(self.lonlat_from_en(en_m)))
    }

    /// How directions turn from this plane to `other` at a place given in this one: meridians converge.
    pub fn turn_to(&self, other: &Self, en_m: Vector2<f64>) -> Rotation2<f64> {
        const STEP_M: f64 = 100.0;
        let here = other.en_from_lonlat(self.lonlat_from_en(en_m));
        let north_of_it =
            other.en_from_lonlat(self.lonlat_from_en(en_m + Vector2::new(0.0, STEP_M)));
        let north = north_of_it - here;
        Rotation2::new(-north.x.atan2(north.y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_comes_back() {
        let plane = LocalPlane::new(LonLat::new(120.7, 24.2));
        let place = plane.lonlat_from_en(Vector2::new(8000.0, -3000.0));
        let back = plane.en_from_lonlat(place);
        assert!((back - Vector2::new(8000.0, -3000.0)).norm() < 1e-6);
    }

    #[test]
    fn directions_turn_with_the_meridians() {
        let plane = LocalPlane::new(LonLat::new(10.0, 60.0));
        let there = Vector2::new(20_000.0, 0.0);
        let other = LocalPlane::new(plane.lonlat_from_en(there));
        let turn = plane.turn_to(&other, there);
        // Going east by geodesic, the azimuth grows by the difference of longitude times the sine of the latitude, so the first
        // plane's north points that much to the east of north there: clockwise.
        let d_lon_deg = other.lonlat_from_en(Vector2::zeros()).lon_deg - 10.0;
        let expected_deg = -d_lon_deg * 60f64.to_radians().sin();
        assert!(
            (turn.angle().to_degrees() - expected_deg).abs() < 0.002,
            "{} {expected_deg}",
            turn.angle().to_degrees()
        );
        // A step in one plane is the same step in the other.
        let step = Vector2::new(30.0, 40.0);
        let same = other.en_from_lonlat(plane.lonlat_from_en(there + step));
        assert!((same - turn * step).norm() < 1e-3);
    }
}
