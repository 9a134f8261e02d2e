//! The paper's own way from tiles to coordinates: linear between two corners.
//!
//! Kept beside [`crate::Georeference`] for `paper` mode and for comparison. Linear interpolation of
//! longitude and latitude is wrong by 0.7 m over 5 km and 24 m over 30 km on a Web Mercator map.

use serde::{Deserialize, Serialize};

use crate::LonLat;

/// The map of the paper: its size and its lower-left and upper-right corners.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PaperCorners {
    /// LL: least longitude and latitude.
    pub lower_left: LonLat,
    /// UR: greatest longitude and latitude.
    pub upper_right: LonLat,
    /// M_w, pixels.
    pub map_width_px: f64,
    /// M_h, pixels.
    pub map_height_px: f64,
}

/// A tile r_ij of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PaperTile {
    /// i, from the top.
    pub row: u64,
    /// j, from the left.
    pub column: u64,
}

impl PaperCorners {
    /// Equations (2a) and (2b): longitude and latitude of a tile's centre, for tiles of side
    /// `tile_px` (S_p) at stride `stride_px`.
    pub fn tile_centre(&self, tile: PaperTile, tile_px: f64, stride_px: f64) -> LonLat {
        let (ll, ur) = (self.lower_left, self.upper_right);
        let x = tile.column as f64 * stride_px + tile_px / 2.0;
        let y = tile.row as f64 * stride_px + tile_px / 2.0;
        LonLat::new(
            ll.lon_deg + x / self.map_width_px * (ur.lon_deg - ll.lon_deg),
            ur.lat_deg - y / self.map_height_px * (ur.lat_deg - ll.lat_deg),
        )
    }

    /// Equation (22): a point at the processing resolution `width_px` x `height_px` in pixels of
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

    /// Equation (23): longitude and latitude of a point of a tile, in pixels of the tile.
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
