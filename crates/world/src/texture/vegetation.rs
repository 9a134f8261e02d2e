//! Grass, gardens, orchards and forest floor.

use nalgebra::Vector2;

use super::crop::crop;
use super::point::{GroundPoint, is_in_stripe};
use crate::colour::{Rgb, rgb8, toned};
use crate::grass::grass;
use crate::ground_noise::{GroundNoise, winding};
use crate::look::Season;
use crate::random::{hash_cell, unit};

type V2 = Vector2<f32>;

/// Mown grass, sometimes in stripes.
pub(super) fn lawn(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let local = point.at.local;
    let seed = point.patch.seed;
    let season = point.season;
    let mown = if seed & 3 == 0 {
        let s = (local.y / 2.6).floor() as i32 & 1;
        0.10 * s as f32
    } else {
        0.0
    };
    let lush = 0.45 + 0.5 * unit(seed >> 1) + 0.35 * mid + 0.45 * coarse + mown;
    (
        toned(grass(season, lush), 1.0 + 0.13 * fine + 0.06 * mid),
        16,
    )
}

/// Long grass with tussocks and trails.
pub(super) fn meadow(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let seed = point.patch.seed;
    let season = point.season;
    let p = point.p;
    let lush = 0.45 + 0.55 * coarse + 0.4 * mid;
    let tussock = if fine + mid > 0.75 { 0.82 } else { 1.0 };
    let trail = winding(p, 0.33, 0.5, unit(seed) * 300.0) * (0.5 + mid).clamp(0.0, 0.8);
    let green = grass(season, lush).mix(rgb8(158, 138, 106), trail);
    (toned(green, (1.0 + 0.18 * fine + 0.12 * mid) * tussock), 17)
}

/// Grass with bare strips under the rows of trees.
pub(super) fn orchard(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let local = point.at.local;
    let season = point.season;
    let strip = (local.y / 4.5 - 0.5).rem_euclid(1.0);
    let bare = ((0.16 - (strip - 0.5).abs()) * 8.0).clamp(0.0, 1.0);
    let soil = toned(rgb8(138, 116, 88), 1.0 + 0.15 * fine);
    let g = toned(
        grass(season, 0.5 + 0.4 * mid + 0.3 * coarse),
        1.0 + 0.15 * fine,
    );
    (g.mix(soil, bare * 0.8), 18)
}

/// Leaf litter.
pub(super) fn forest_floor(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    let season = point.season;
    let litter = match season {
        Season::Summer | Season::Spring => rgb8(62, 64, 40),
        _ => rgb8(104, 84, 62),
    };
    (toned(litter, 1.0 + 0.3 * fine + 0.2 * mid), 19)
}

/// A patchwork of lawn, beds, bushes and paving.
pub(super) fn garden(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let local = point.at.local;
    let seed = point.patch.seed;
    let season = point.season;
    let cell = V2::new((local.x / 4.7).floor(), (local.y / 3.6).floor());
    let h = hash_cell(seed, cell.x as i32, cell.y as i32);
    let base = match h % 11 {
        0 => rgb8(122, 100, 76),
        1 => rgb8(154, 148, 138),
        2 => rgb8(66, 78, 42),
        _ => grass(
            season,
            0.5 + 0.5 * unit(seed) - 0.2 + 0.4 * mid + 0.2 * coarse,
        ),
    };
    (
        toned(base, 1.0 + 0.16 * fine + 0.10 * mid),
        20 + (h % 11).min(3),
    )
}

/// Small beds of different crops with paths between them.
pub(super) fn allotment(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, .. } = *point.noise;
    let local = point.at.local;
    let seed = point.patch.seed;
    let season = point.season;
    let cell = V2::new((local.x / 9.0).floor(), (local.y / 1.9).floor());
    let h = hash_cell(seed, cell.x as i32, cell.y as i32);
    let (colour, ..) = crop(h, season);
    let path = is_in_stripe(local.x, 9.0, 0.8) || is_in_stripe(local.y, 1.9, 0.35);
    let base = if path { rgb8(140, 124, 100) } else { colour };
    (
        toned(base, 0.95 + 0.2 * unit(h.rotate_left(7)) + 0.2 * fine),
        24 + (h & 7),
    )
}

/// Rows of gravestones with paths.
pub(super) fn graves(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    let local = point.at.local;
    let seed = point.patch.seed;
    let season = point.season;
    let cell = V2::new((local.x / 2.6).floor(), (local.y / 1.5).floor());
    let h = hash_cell(seed, cell.x as i32, cell.y as i32);
    let (fx, fy) = (local.x.rem_euclid(2.6), local.y.rem_euclid(1.5));
    let path = is_in_stripe(local.x, 23.4, 2.4) || is_in_stripe(local.y, 18.0, 1.8);
    if path {
        return (toned(rgb8(168, 156, 136), 1.0 + 0.12 * fine), 52);
    }
    if (0.3..2.2).contains(&fx) && (0.25..1.1).contains(&fy) && h % 10 < 8 {
        let stone = rgb8(90, 88, 90).mix(rgb8(190, 186, 178), unit(h));
        return (toned(stone, 1.0 + 0.1 * fine), 53);
    }
    (toned(grass(season, 0.5 + 0.4 * mid), 1.0 + 0.15 * fine), 54)
}
