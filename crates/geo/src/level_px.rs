//! Points of a level, in pixels.

use serde::{Deserialize, Serialize};

/// A continuous point of a level, in pixels of the level: `(0, 0)` is the outer corner of the
/// top-left pixel, `x` grows to the right and `y` downwards. See [`crate::LevelFrame`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LevelPx {
    /// Columns from the left edge.
    pub x: f64,
    /// Rows from the top edge.
    pub y: f64,
}

impl LevelPx {
    /// The point `x` columns from the left edge and `y` rows from the top edge.
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    /// The point moved by `dx` columns to the right and `dy` rows down.
    pub fn offset(self, dx: f64, dy: f64) -> Self {
        Self::new(self.x + dx, self.y + dy)
    }
}

impl From<[f64; 2]> for LevelPx {
    fn from([x, y]: [f64; 2]) -> Self {
        Self::new(x, y)
    }
}

impl From<LevelPx> for [f64; 2] {
    fn from(point: LevelPx) -> Self {
        [point.x, point.y]
    }
}
