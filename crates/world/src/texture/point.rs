//! A point of a patch of ground, the input of the textures.

use nalgebra::Vector2;

use crate::cover::{Inside, Patch};
use crate::ground_noise::GroundNoise;
use crate::look::Season;

/// A ground point to be coloured.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroundPoint<'a> {
    /// The patch that it lies in.
    pub(crate) patch: &'a Patch,
    /// Its position in the patch.
    pub(crate) at: &'a Inside,
    /// World or layout coordinates, as the patch has them, metres.
    pub(crate) p: Vector2<f32>,
    pub(crate) noise: &'a GroundNoise,
    pub(crate) season: Season,
    /// Size of a pixel on the ground, metres.
    pub(crate) pixel_m: f32,
}

impl GroundPoint<'_> {
    /// How well a pattern of this period (metres) is resolved: 0 not at all, 1 fully.
    pub(crate) fn resolved(&self, period_m: f32) -> f32 {
        ((period_m / self.pixel_m - 1.6) * 0.8).clamp(0.0, 1.0)
    }
}

/// Whether `x` lies in the first `width_m` of its period.
pub(crate) fn is_in_stripe(x: f32, period_m: f32, width_m: f32) -> bool {
    x.rem_euclid(period_m) < width_m
}
