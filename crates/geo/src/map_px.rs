//! Points and windows of the full-resolution map, in pixels.

use serde::{Deserialize, Serialize};

/// A continuous point of the full-resolution map, in pixels: `(0, 0)` is the outer corner of the
/// top-left pixel (GDAL's convention), `x` grows to the right and `y` downwards.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapPx {
    /// Columns from the left edge.
    pub x: f64,
    /// Rows from the top edge.
    pub y: f64,
}

impl MapPx {
    /// The point `x` columns from the left edge and `y` rows from the top edge.
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }
}

/// A rectangle of the map in continuous pixels. It may reach outside the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WindowPx {
    /// Left edge.
    pub x: f64,
    /// Top edge.
    pub y: f64,
    /// Width, above zero.
    pub w: f64,
    /// Height, above zero.
    pub h: f64,
}

impl WindowPx {
    /// The window whose top-left corner is `(x, y)`, `w` wide and `h` high.
    pub const fn new(x: f64, y: f64, w: f64, h: f64) -> Self {
        Self { x, y, w, h }
    }

    /// Its centre.
    pub fn centre(&self) -> MapPx {
        MapPx::new(self.x + 0.5 * self.w, self.y + 0.5 * self.h)
    }
}

impl std::fmt::Display for WindowPx {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "({}, {}) {} x {}", self.x, self.y, self.w, self.h)
    }
}
