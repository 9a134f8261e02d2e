//! The ground resolutions of the default mode.

use crate::level::TILE_PX;

/// Finest resolution that [`crate::Levels::Auto`] makes, metres per pixel: drones fly too high for finer pixels to be
/// useful.
pub const FINEST_AUTO_GSD_M: f64 = 0.15;

/// Resolutions a factor of two apart, until a tile is about `max_tile_m` wide or covers the map.
pub fn auto_gsds_m(own_gsd_m: f64, map_m: [f64; 2], max_tile_m: f64) -> Vec<f64> {
    let mut gsds_m = vec![own_gsd_m.max(FINEST_AUTO_GSD_M)];
    loop {
        let last = gsds_m[gsds_m.len() - 1];
        let tile_m = last * f64::from(TILE_PX);
        // The next tile would be further from `max_tile_m`, by ratio, than this one.
        let about_max = 2.0 * tile_m > max_tile_m * std::f64::consts::SQRT_2;
        if about_max || map_m.iter().all(|&m| tile_m >= m) {
            return gsds_m;
        }
        gsds_m.push(2.0 * last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auto_levels_go_up_to_a_kilometre_or_the_map() {
        assert_eq!(
            auto_gsds_m(0.25, [9000.0, 9000.0], 1000.0),
            [0.25, 0.5, 1.0, 2.0]
        );
        assert_eq!(
            auto_gsds_m(0.05, [9000.0, 9000.0], 1000.0)[0],
            FINEST_AUTO_GSD_M
        );
        assert_eq!(
            auto_gsds_m(0.16, [656.0, 623.0], 1000.0),
            [0.16, 0.32, 0.64, 1.28, 2.56]
        );
        assert_eq!(auto_gsds_m(0.2, [50.0, 90.0], 1000.0), [0.2]);
        assert_eq!(auto_gsds_m(10.0, [1e6, 1e6], 1000.0), [10.0]);
    }
}
