//! The pixel frame of a tile, at the resolution of the query.

use grimnet_geo::LevelPx;
use grimnet_pack::Level;
use nalgebra::Point2;

use crate::{error::Result, query_features::PIXEL_CENTRE};

/// A continuous point of a tile at the resolution of the query: what a transform from query to tile maps to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TilePx {
    /// Columns from the left edge.
    pub x: f64,
    /// Rows from the top edge.
    pub y: f64,
}

impl From<Point2<f64>> for TilePx {
    fn from(point: Point2<f64>) -> Self {
        Self {
            x: point.x,
            y: point.y,
        }
    }
}

impl From<TilePx> for Point2<f64> {
    fn from(point: TilePx) -> Self {
        Self::new(point.x, point.y)
    }
}

/// The frame of a tile at the resolution of the query.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TileFrame {
    /// Top-left corner.
    pub origin: LevelPx,
    /// Level pixels per query pixel: 1 except in packs that were built in paper mode.
    pub level_px_per_query_px: f64,
}

impl TileFrame {
    /// The frame of `tile`.
    pub fn new(level: &Level, tile: usize) -> Self {
        let [x, y] = level.tile(tile).origin_px;
        Self {
            origin: LevelPx::new(x as f64, y as f64),
            level_px_per_query_px: level.px_per_network_px(),
        }
    }

    /// The point of a keypoint, which is given by its integer pixel in the tile at the level's resolution.
    pub fn tile_px_from_keypoint(&self, keypoint_px: Point2<f32>) -> TilePx {
        keypoint_px
            .map(|along| f64::from(along + PIXEL_CENTRE) / self.level_px_per_query_px)
            .into()
    }

    /// The point of the level that a point of the tile is.
    pub fn level_px_from_tile_px(&self, point: TilePx) -> LevelPx {
        let s = self.level_px_per_query_px;
        self.origin.offset(point.x * s, point.y * s)
    }
}

/// Ground resolution of queries for a level, metres per pixel.
pub(crate) fn query_gsd_m(level: &Level) -> f64 {
    level.gsd_m() * level.px_per_network_px()
}

/// Bearing of the level's up direction at its centre, degrees clockwise from true north.
pub(crate) fn up_bearing_deg(level: &Level) -> Result<f64> {
    let georeference = level.georeference();
    Ok(georeference.up_bearing_deg(georeference.centre_px())?)
}
