//! Asphalt, concrete, slabs, gravel and bare soil.

use nalgebra::Vector2;

use super::point::{GroundPoint, is_in_stripe};
use crate::colour::{Rgb, rgb8, toned};
use crate::grass::grass;
use crate::ground_noise::{GroundNoise, winding};
use crate::noise::fbm;
use crate::random::{hash_cell, hash2, unit};

type V2 = Vector2<f32>;

/// Worn asphalt with cracks, tyre marks and repairs.
fn worn_asphalt(seed: u32, local: V2, noise: &GroundNoise) -> Rgb {
    let base = rgb8(86, 86, 88).mix(rgb8(134, 130, 124), unit(hash2(seed, 9)));
    let cell = V2::new((local.x / 8.0).floor(), (local.y / 11.0).floor());
    let h = hash_cell(seed, cell.x as i32, cell.y as i32);
    let crack = 1.0 - 0.28 * winding(local, 1.1, 0.12, unit(seed) * 411.0);
    let tyres = 1.0 - 0.16 * winding(local, 0.42, 0.5, unit(seed) * 211.0 + 50.0);
    let patched = if h.is_multiple_of(6) {
        0.78 + 0.4 * unit(h.rotate_left(13))
    } else {
        1.0
    };
    toned(
        base,
        (1.0 + 0.10 * noise.fine + 0.12 * noise.mid + 0.1 * noise.coarse) * patched * crack * tyres,
    )
}

/// Asphalt.
pub(super) fn asphalt(point: &GroundPoint<'_>) -> (Rgb, u32) {
    (
        worn_asphalt(point.patch.seed, point.at.local, point.noise),
        32,
    )
}

/// Asphalt with the markings of parking bays.
pub(super) fn parking(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, .. } = *point.noise;
    let patch = point.patch;
    let at = point.at;
    let local = point.at.local;
    let seed = point.patch.seed;
    let base = worn_asphalt(seed, local, point.noise);
    let row = (local.y + patch.half.y).rem_euclid(16.5);
    let in_bay = !(5.0..=11.5).contains(&row);
    let line =
        in_bay && is_in_stripe(local.x + patch.half.x, 2.6, 0.14) || (row - 16.2).abs() < 0.08;
    if line && at.depth > 0.4 {
        (
            base.mix(
                rgb8(222, 222, 216),
                0.8 * (0.8 + 0.5 * fine).clamp(0.0, 1.0),
            ),
            34,
        )
    } else {
        (base, 33)
    }
}

/// Concrete in slabs of 5 m.
pub(super) fn concrete(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let local = point.at.local;
    let seed = point.patch.seed;
    let tone = 1.0 + 0.10 * fine + 0.14 * mid + 0.10 * coarse;
    let joint = is_in_stripe(local.x, 5.0, 0.12) || is_in_stripe(local.y, 5.0, 0.12);
    let slab = hash_cell(
        seed,
        (local.x / 5.0).floor() as i32,
        (local.y / 5.0).floor() as i32,
    );
    let tone = tone * (0.93 + 0.14 * unit(slab)) * if joint { 0.84 } else { 1.0 };
    let base = rgb8(150, 148, 142).mix(rgb8(188, 180, 166), unit(seed));
    (toned(base, tone), 35)
}

/// Paving slabs of 1.6 m.
pub(super) fn slabs(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    let local = point.at.local;
    let seed = point.patch.seed;
    let cell = V2::new((local.x / 1.6).floor(), (local.y / 1.6).floor());
    let h = hash_cell(seed, cell.x as i32, cell.y as i32);
    let base = match seed & 3 {
        0 => rgb8(172, 150, 132),
        1 => rgb8(160, 156, 150),
        2 => rgb8(150, 118, 100),
        _ => rgb8(186, 178, 160),
    };
    (
        toned(
            base,
            0.92 + 0.14 * unit(h) * point.resolved(1.6) + 0.1 * fine + 0.08 * mid,
        ),
        36,
    )
}

/// Gravel.
pub(super) fn gravel(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    let seed = point.patch.seed;
    let base = rgb8(166, 158, 144).mix(rgb8(134, 124, 110), unit(seed));
    (toned(base, 1.0 + 0.16 * fine + 0.14 * mid), 37)
}

/// Bare soil with weeds.
pub(super) fn dirt(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let season = point.season;
    let base = rgb8(150, 126, 96).mix(rgb8(120, 98, 74), 0.5 + 0.6 * mid);
    let weeds = ((coarse + 0.7 * mid + 0.4 * fine) * 2.0 - 0.4).clamp(0.0, 0.8);
    (
        toned(base.mix(grass(season, 0.4), weeds), 1.0 + 0.18 * fine),
        38,
    )
}

/// Sand.
pub(super) fn sand(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    (
        toned(rgb8(204, 188, 152), 1.0 + 0.08 * fine + 0.08 * mid),
        39,
    )
}

/// Two railway tracks (gauge 1.435 m) on ballast.
pub(super) fn ballast(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    let at = point.at;
    let local = point.at.local;
    let season = point.season;
    let tone = 1.0 + 0.18 * fine + 0.08 * mid;
    let side = local.y.abs();
    // Two tracks, 1.435 m gauge.
    let off = (side - 2.1).abs();
    if (off - 0.72).abs() < 0.09 {
        return (rgb8(150, 142, 136), 50);
    }
    let tie = off < 1.3 && is_in_stripe(local.x, 0.65, 0.26);
    let base = if tie {
        rgb8(112, 106, 100)
    } else {
        rgb8(134, 122, 112)
    };
    let weeds = ((1.0 - at.depth) + 0.6 * mid).clamp(0.0, 0.8);
    (toned(base.mix(grass(season, 0.4), weeds), tone), 51)
}

/// The bare, rutted soil of a construction site.
pub(super) fn construction_site(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let local = point.at.local;
    let base = rgb8(178, 150, 112).mix(rgb8(140, 112, 84), 0.5 + 0.8 * mid);
    let rut = fbm(local.x * 0.8 + 9.0, local.y * 6.0);
    (
        toned(base, 1.0 + 0.18 * fine + 0.14 * rut + 0.15 * coarse),
        55,
    )
}
