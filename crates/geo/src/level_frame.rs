//! A level: the map resampled to square ground pixels.

use serde::{Deserialize, Serialize};

use crate::{GeoError, Georeference, LevelPx, MapPx, WindowPx};

/// The frame of a level: the map at a given ground resolution. Its axes are those of the map. x and y have different
/// scales, so that pixels are square on the ground at the map's centre also if the map's are not (a geographic CRS), but for
/// [`LevelFrame::of_map_pixels`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LevelFrame {
    /// Metres per level pixel at the map's centre.
    pub gsd_m: f64,
    /// Map pixels per level pixel along x.
    pub map_px_per_level_px_x: f64,
    /// Map pixels per level pixel along y.
    pub map_px_per_level_px_y: f64,
    /// Width of the level, pixels; the last column may reach beyond the map.
    pub width_px: u64,
    /// Height of the level, pixels.
    pub height_px: u64,
}

impl LevelFrame {
    /// The level of `gsd_m` metres per pixel over a map of `size_px`.
    ///
    /// # Errors
    /// Returns [`GeoError::BadResolution`] if `gsd_m` is not a positive number, [`GeoError::OutsideDomain`] if the map's
    /// centre has no position on Earth.
    pub fn new(
        georeference: &Georeference,
        size_px: (u64, u64),
        gsd_m: f64,
    ) -> Result<Self, GeoError> {
        if !(gsd_m.is_finite() && gsd_m > 0.0) {
            return Err(GeoError::BadResolution { gsd_m });
        }
        let centre = MapPx::new(size_px.0 as f64 / 2.0, size_px.1 as f64 / 2.0);
        let (x_m, y_m) = georeference.ground_resolution_m(centre)?;
        let (scale_x, scale_y) = (gsd_m / x_m, gsd_m / y_m);
        // A remainder below a thousandth of a pixel is a rounding error.
        let count = |side: u64, scale: f64| ((side as f64 / scale - 1e-3).ceil() as u64).max(1);
        Ok(Self {
            gsd_m,
            map_px_per_level_px_x: scale_x,
            map_px_per_level_px_y: scale_y,
            width_px: count(size_px.0, scale_x),
            height_px: count(size_px.1, scale_y),
        })
    }

    /// The level whose pixels are the map's own, whatever their shape; `gsd_m` is the side of a square of the same area at the map's
    /// centre.
    ///
    /// # Errors
    /// Returns [`GeoError::OutsideDomain`] if the map's centre has no position on Earth.
    pub fn of_map_pixels(
        georeference: &Georeference,
        size_px: (u64, u64),
    ) -> Result<Self, GeoError> {
        let centre = MapPx::new(size_px.0 as f64 / 2.0, size_px.1 as f64 / 2.0);
        let (x_m, y_m) = georeference.ground_resolution_m(centre)?;
        Ok(Self {
            gsd_m: (x_m * y_m).sqrt(),
            map_px_per_level_px_x: 1.0,
            map_px_per_level_px_y: 1.0,
            width_px: size_px.0,
            height_px: size_px.1,
        })
    }

    /// Map pixel of a point of the level.
    pub fn map_px_from_level_px(&self, point: LevelPx) -> MapPx {
        MapPx::new(
            point.x * self.map_px_per_level_px_x,
            point.y * self.map_px_per_level_px_y,
        )
    }

    /// Point of the level that a map pixel lies at.
    pub fn level_px_from_map_px(&self, point: MapPx) -> LevelPx {
        LevelPx::new(
            point.x / self.map_px_per_level_px_x,
            point.y / self.map_px_per_level_px_y,
        )
    }

    /// The window of the map that a rectangle of the level covers: its top-left corner, width and
    /// height, the latter two in level pixels.
    pub fn map_window(&self, top_left: LevelPx, width_px: f64, height_px: f64) -> WindowPx {
        WindowPx::new(
            top_left.x * self.map_px_per_level_px_x,
            top_left.y * self.map_px_per_level_px_y,
            width_px * self.map_px_per_level_px_x,
            height_px * self.map_px_per_level_px_y,
        )
    }
}
