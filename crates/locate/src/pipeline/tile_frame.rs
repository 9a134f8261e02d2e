//! The pixel frame of a tile, at the resolution of the query.

use grimnet_pack::Level;
use nalgebra::{Point2, Vector2};

use crate::query_features::PIXEL_CENTRE;

/// The frame of a tile at the resolution of the query.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TileFrame {
    /// Top-left corner, level pixels.
    pub origin_px: Vector2<f64>,
    /// Level pixels per query pixel: 1 except in packs that were built in paper mode.
    pub level_px_per_query_px: f64,
}

impl TileFrame {
    /// The frame of `tile`.
    pub fn new(level: &Level, tile: usize) -> Self {
        let [x, y] = level.tile(tile).origin_px;
        Self {
            origin_px: Vector2::new(x as f64, y as f64),
            level_px_per_query_px: level_px_per_query_px(level),
        }
    }

    /// Continuous tile pixel at the query's resolution, from the integer position of a keypoint at the level's resolution.
    pub fn tile_px_from_keypoint(&self, keypoint_px: Point2<f32>) -> Point2<f64> {
        keypoint_px.map(|along| f64::from(along + PIXEL_CENTRE) / self.level_px_per_query_px)
    }

    /// Continuous level pixel, from a tile pixel at the query's resolution.
    pub fn level_px_from_tile_px(&self, in_tile_px: Point2<f64>) -> [f64; 2] {
        (self.origin_px + in_tile_px.coords * self.level_px_per_query_px).into()
    }
}

/// Level pixels per pixel of the picture that the network saw.
pub(crate) fn level_px_per_query_px(level: &Level) -> f64 {
    f64::from(level.tile_px()) / f64::from(level.manifest().network_px)
}
