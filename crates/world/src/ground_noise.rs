//! Noise that the textures of the ground share.

use nalgebra::Vector2;

use crate::noise::{fbm, split_floor};
use crate::random::{hash_cell, hash2, unit};

type V2 = Vector2<f32>;

/// Noise at a ground point, about -1 to 1 each: features of 0.2-6 m, 1-40 m and 12-350 m.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroundNoise {
    pub(crate) fine: f32,
    pub(crate) mid: f32,
    pub(crate) coarse: f32,
}

impl GroundNoise {
    /// The noise at `p` (metres). Detail finer than `pixel_m`, the size of a pixel on the ground, fades out.
    #[inline]
    pub(crate) fn at(p: V2, pixel_m: f32) -> Self {
        Self {
            fine: fbm(p.x * 8.3 + p.y * 2.1, p.y * 8.3 - p.x * 2.1) * (0.22 / pixel_m).min(1.2),
            mid: fbm(p.x * 1.5 - p.y * 0.7 + 91.0, p.y * 1.5 + p.x * 0.7),
            coarse: fbm(p.x * 0.17 + p.y * 0.04, p.y * 0.17 - p.x * 0.04 + 57.0),
        }
    }
}

/// Factor on the colour from small objects and plants on the ground; the same in every picture.
pub(crate) fn specks(p: V2, strength: f32) -> f32 {
    let mut tone = 1.0;
    for (seed, cell, share) in [(0x5eed_u32, 2.3_f32, 0.30_f32), (0x0b1e, 6.1, 0.35)] {
        let ((ix, fx), (iy, fy)) = (split_floor(p.x / cell), split_floor(p.y / cell));
        let h = hash_cell(seed, ix, iy);
        if unit(h) > share {
            continue;
        }
        let a = hash2(h, 1);
        let middle = V2::new(0.25 + 0.5 * unit(a), 0.25 + 0.5 * unit(a.rotate_left(16))) * cell;
        let d = V2::new(p.x - fx * cell, p.y - fy * cell) - middle;
        let radius = cell * (0.06 + 0.14 * unit(a.rotate_left(8)));
        let stretch = 0.6 + 0.9 * unit(a.rotate_left(24));
        let r = (d.x * stretch).abs().max((d.y / stretch).abs()) * 0.5
            + 0.5 * (d.x * stretch).hypot(d.y / stretch);
        let inside = ((1.0 - r / radius) * 4.0).clamp(0.0, 1.0);
        let sign = if h & 0x10 == 0 { 0.8 } else { -1.0 };
        tone += strength * sign * inside * (0.4 + 0.6 * unit(h.rotate_left(12)));
    }
    tone
}

/// 1 on thin winding lines (the zero contour of a noise of `scale` units per metre), else 0.
pub(crate) fn winding(p: V2, scale: f32, width_m: f32, shift: f32) -> f32 {
    let value = fbm(p.x * scale + shift, p.y * scale - shift);
    // The noise's slope is about 0.2 per table unit.
    (1.5 - value.abs() / (width_m * scale * 0.12)).clamp(0.0, 1.0)
}
