//! The ground resolutions of the default mode.

use crate::level::TILE_PX;

/// Finest resolution that [`crate::Levels::Auto`] makes, metres per pixel: drones fly too high for finer pixels to be
/// useful.
pub const FINEST_AUTO_GSD_M: f64 = 0.15;

/// A map that is coarser than this is also searched in finer pixels than its own, metres per pixel: the network needs a few hundred pixels
/// across a photo, whatever detail they hold. At 120 m above ground a photo shows some 165 m.
pub const COARSEST_FINE_GSD_M: f64 = 0.6;

/// Most halvings of a map's own pixels. Maps that are coarser still are for flights far above 120 m, and keep their own resolution.
const MAX_HALVINGS: i32 = 3;

/// The finest resolution: the map's own, or finer by a power of two where that is too coarse for photos from 120 m above ground.
fn finest_gsd_m(own_gsd_m: f64) -> f64 {
    let halvings = (own_gsd_m / COARSEST_FINE_GSD_M).log2().ceil() as i32;
    match halvings {
        1..=MAX_HALVINGS => own_gsd_m / 2_f64.powi(halvings),
        _ => own_gsd_m.max(FINEST_AUTO_GSD_M),
    }
}

/// Resolutions a factor of two apart, until a tile is about `max_tile_m` wide or covers the map.
pub fn auto_gsds_m(own_gsd_m: f64, map_m: [f64; 2], max_tile_m: f64) -> Vec<f64> {
    let mut gsds_m = vec![finest_gsd_m(own_gsd_m)];
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

    #[test]
    fn coarse_maps_get_finer_levels_than_their_own_pixels() {
        let finest = |own_gsd_m| auto_gsds_m(own_gsd_m, [9000.0, 9000.0], 1000.0)[0];
        assert_eq!(finest(0.6), 0.6);
        assert_eq!(finest(0.8), 0.4);
        assert_eq!(finest(1.6), 0.4);
        assert_eq!(finest(4.8), 0.6);
        assert_eq!(finest(5.0), 5.0);
        assert_eq!(auto_gsds_m(1.6, [9000.0, 9000.0], 1000.0), [0.4, 0.8, 1.6]);
    }
}
