//! The paper's equations from tiles to coordinates, linear between two corners of the map.
//!
//! Linear interpolation of longitude and latitude is wrong by 0.7 m over 5 km and 24 m over 30 km on a Web Mercator map, and by far more
//! on a grid whose north is not that of the meridian: by 22 m over 700 m in UTM where the two are 1.3 degrees apart. So default mode uses
//! [`grimnet_geo::Georeference`], and building a paper mode pack of such a map says how wrong it will be.

use grimnet_geo::LonLat;

/// Size, lower left and upper right corner of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapCorners {
    /// LL: least longitude and latitude.
    pub lower_left: LonLat,
    /// UR: greatest longitude and latitude.
    pub upper_right: LonLat,
    /// M_w, pixels.
    pub map_width_px: f64,
    /// M_h, pixels.
    pub map_height_px: f64,
}

/// Row and column of a tile r_ij.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TileIndex {
    /// i, from the top.
    pub row: u64,
    /// j, from the left.
    pub column: u64,
}

impl MapCorners {
    /// Eq. 2a and 2b: longitude and latitude of a tile's centre, for tiles of side
    /// `tile_px` (S_p) at stride `stride_px`.
    pub fn tile_centre(&self, tile: TileIndex, tile_px: f64, stride_px: f64) -> LonLat {
        let (ll, ur) = (self.lower_left, self.upper_right);
        let x = tile.column as f64 * stride_px + tile_px / 2.0;
        let y = tile.row as f64 * stride_px + tile_px / 2.0;
        LonLat::new(
            ll.lon_deg + x / self.map_width_px * (ur.lon_deg - ll.lon_deg),
            ur.lat_deg - y / self.map_height_px * (ur.lat_deg - ll.lat_deg),
        )
    }

    /// Eq. 22: a point at the processing resolution `width_px` x `height_px` in pixels of
    /// the tile of side `tile_px`.
    pub fn tile_px_from_processing_px(
        point_px: (f64, f64),
        width_px: f64,
        height_px: f64,
        tile_px: f64,
    ) -> (f64, f64) {
        (
            point_px.0 * tile_px / width_px,
            point_px.1 * tile_px / height_px,
        )
    }

    /// Eq. 23: longitude and latitude of a point of a tile, in pixels of the tile.
    pub fn lonlat_from_tile_px(
        &self,
        tile_centre: LonLat,
        point_in_tile_px: (f64, f64),
        tile_px: f64,
    ) -> LonLat {
        let (ll, ur) = (self.lower_left, self.upper_right);
        let right = point_in_tile_px.0 / tile_px - 0.5;
        let down = point_in_tile_px.1 / tile_px - 0.5;
        LonLat::new(
            tile_centre.lon_deg + right * (ur.lon_deg - ll.lon_deg) * tile_px / self.map_width_px,
            tile_centre.lat_deg - down * (ur.lat_deg - ll.lat_deg) * tile_px / self.map_height_px,
        )
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use grimnet_geo::{Corners, Crs, Georeference, MapPx, distance_m};

    use super::*;

    #[test]
    fn equations_2_22_and_23_by_hand() {
        let map = MapCorners {
            lower_left: LonLat::new(-2.30, 53.40),
            upper_right: LonLat::new(-2.20, 53.48),
            map_width_px: 10_000.0,
            map_height_px: 8_000.0,
        };
        // (2a): -2.30 + (3 * 256 + 256) / 10000 * 0.10 = -2.30 + 0.01024;
        // (2b): 53.48 - (2 * 256 + 256) / 8000 * 0.08 = 53.48 - 0.00768.
        let centre = map.tile_centre(TileIndex { row: 2, column: 3 }, 512.0, 256.0);
        assert_relative_eq!(centre.lon_deg, -2.28976, epsilon = 1e-12);
        assert_relative_eq!(centre.lat_deg, 53.47232, epsilon = 1e-12);
        // (22): (200, 80) of 320 x 320 is (320, 128) of 512 x 512.
        let px = MapCorners::tile_px_from_processing_px((200.0, 80.0), 320.0, 320.0, 512.0);
        assert_eq!(px, (320.0, 128.0));
        // And of 640 x 320: (160, 128).
        let wide = MapCorners::tile_px_from_processing_px((200.0, 80.0), 640.0, 320.0, 512.0);
        assert_eq!(wide, (160.0, 128.0));
        // (23): lon + (320/512 - 0.5) * 0.1 * 512/10000 = lon + 0.125 * 0.00512;
        //       lat - (128/512 - 0.5) * 0.08 * 512/8000 = lat + 0.25 * 0.00512.
        let place = map.lonlat_from_tile_px(centre, px, 512.0);
        assert_relative_eq!(place.lon_deg, -2.28976 + 0.00064, epsilon = 1e-12);
        assert_relative_eq!(place.lat_deg, 53.47232 + 0.00128, epsilon = 1e-12);
    }

    #[test]
    fn the_papers_equations_are_the_affine_of_the_corners() {
        // Tile (i, j) and a point in it, the paper's way and through the georeference.
        let (ll, ur) = (LonLat::new(120.70, 24.20), LonLat::new(120.73, 24.22));
        let size = (6000, 4400);
        let corners = Corners::new(ll, ur, size, "test", "").unwrap();
        let map = Georeference::new(corners.affine(size).unwrap(), Crs::wgs84().unwrap(), size);
        let paper = MapCorners {
            lower_left: ll,
            upper_right: ur,
            map_width_px: 6000.0,
            map_height_px: 4400.0,
        };
        for (row, column, x, y) in [
            (0, 0, 0.0, 0.0),
            (3, 5, 100.0, 400.5),
            (15, 21, 511.0, 256.0),
        ] {
            let centre = paper.tile_centre(TileIndex { row, column }, 512.0, 256.0);
            let theirs = paper.lonlat_from_tile_px(centre, (x, y), 512.0);
            let px = MapPx::new(column as f64 * 256.0 + x, row as f64 * 256.0 + y);
            let ours = map.lonlat_from_map_px(px).unwrap();
            assert!(distance_m(ours, theirs) < 1e-6);
        }
    }
}
