//! Web Mercator (EPSG:3857) as a square that holds the world: tiles are its parts.

use std::f64::consts::PI;

use crate::metres::LonLat;

/// Where a place lies in the square: x from 0 at 180 degrees west to 1 in the east, y from 0 at 85.05 degrees north to 1 in the south
/// (EPSG:3857, metres over the side of the square, 2 pi 6378137). Places nearer to a pole have a y outside 0 to 1.
#[must_use]
pub fn web_mercator_from_lonlat(place: LonLat) -> [f64; 2] {
    [
        place.lon_deg / 360.0 + 0.5,
        0.5 - place.lat_deg.to_radians().tan().asinh() / (2.0 * PI),
    ]
}

/// The place at a point of the square, as [`web_mercator_from_lonlat`] counts.
#[must_use]
pub fn lonlat_from_web_mercator([x, y]: [f64; 2]) -> LonLat {
    LonLat {
        lon_deg: x * 360.0 - 180.0,
        lat_deg: (PI * (1.0 - 2.0 * y)).sinh().atan().to_degrees(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crs::Crs;
    use crate::metres::WGS84_A_M;

    #[test]
    fn the_square_is_that_of_epsg_3857() {
        let mercator = Crs::from_epsg(3857).unwrap();
        let half_m = PI * WGS84_A_M;
        for place in [
            LonLat::new(-0.35, 51.62),
            LonLat::new(179.9, -43.5),
            LonLat::new(-120.0, 0.0),
            LonLat::new(10.0, 86.0),
        ] {
            let [x, y] = web_mercator_from_lonlat(place);
            let (east_m, north_m) = mercator.xy_from_lonlat(place).unwrap();
            assert!(
                (half_m * (2.0 * x - 1.0) - east_m).abs() < 1e-5,
                "{place:?}"
            );
            assert!(
                (half_m * (1.0 - 2.0 * y) - north_m).abs() < 1e-5,
                "{place:?}"
            );
            let back = lonlat_from_web_mercator([x, y]);
            assert!((back.lon_deg - place.lon_deg).abs() < 1e-12, "{back:?}");
            assert!((back.lat_deg - place.lat_deg).abs() < 1e-12, "{back:?}");
        }
    }
}
