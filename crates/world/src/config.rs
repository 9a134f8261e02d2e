//! The configuration of a world.

use serde::{Deserialize, Serialize};

/// The configuration of a [`crate::World`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldConfig {
    /// Seed of everything random: the same seed gives the same world.
    pub seed: u64,
    /// Side of the square map, metres; clamped to 100..=8000.
    pub size_m: f64,
    /// Share of the map that is town, 0 to 1; the rest is countryside.
    pub urban: f32,
    /// Curvature of the roads: 0 straight, 1 strongly curved.
    pub bend: f32,
}

impl Default for WorldConfig {
    /// 1.2 km x 1.2 km, 55 % of it town.
    fn default() -> Self {
        Self {
            seed: 1,
            size_m: 1200.0,
            urban: 0.55,
            bend: 0.5,
        }
    }
}

impl WorldConfig {
    /// The configuration with every value within its range.
    pub(crate) fn clamped(self) -> Self {
        Self {
            size_m: if self.size_m.is_finite() {
                self.size_m.clamp(100.0, 8000.0)
            } else {
                1200.0
            },
            urban: self.urban.clamp(0.0, 1.0),
            bend: self.bend.clamp(0.0, 1.0),
            ..self
        }
    }
}
