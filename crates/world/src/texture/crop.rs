//! Fields of crops.

use super::point::GroundPoint;
use crate::colour::{Rgb, rgb8, toned};
use crate::grass::grass;
use crate::ground_noise::GroundNoise;
use crate::look::Season;
use crate::noise::fbm;
use crate::random::{hash_cell, hash2, unit};

/// Colour of a crop, amplitude of its rows, and their period in metres.
pub(super) fn crop(seed: u32, season: Season) -> (Rgb, f32, f32) {
    const BARE: [Rgb; 4] = [
        rgb8(126, 100, 74),
        rgb8(108, 86, 66),
        rgb8(146, 122, 94),
        rgb8(120, 104, 88),
    ];
    let bare = BARE[(seed >> 5 & 3) as usize];
    match (seed % 7, season) {
        (0, Season::Spring) | (1, Season::Winter | Season::Autumn) => {
            (rgb8(96, 124, 62), 0.12, 1.6)
        }
        (0, Season::Summer) => (rgb8(196, 168, 104), 0.10, 1.9),
        (0, _) => (rgb8(180, 160, 118), 0.16, 2.4),
        (1, Season::Summer) => (rgb8(178, 160, 98), 0.12, 1.7),
        (1, Season::Spring) => (rgb8(88, 118, 54), 0.10, 1.7),
        (2, Season::Spring) => (rgb8(206, 196, 62), 0.08, 2.0),
        (2, Season::Summer) => (rgb8(150, 138, 84), 0.10, 2.0),
        (3, Season::Summer) => (rgb8(66, 94, 42), 0.22, 1.5),
        (3, Season::Autumn) => (rgb8(166, 142, 88), 0.20, 1.5),
        (4, Season::Summer) => (rgb8(82, 110, 50), 0.34, 2.2),
        (5, Season::Spring) => (rgb8(104, 130, 60), 0.08, 3.0),
        (5, Season::Summer | Season::Autumn) => (rgb8(110, 122, 62), 0.10, 3.0),
        (5, Season::Winter) => (rgb8(120, 116, 78), 0.10, 3.0),
        (6, Season::Summer) => (rgb8(96, 106, 56), 0.28, 1.8),
        _ => (bare, 0.26, 2.0),
    }
}

/// A field: rows, bands, tramlines, soil, and a grassy edge.
pub(super) fn field(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundPoint {
        patch,
        at,
        season,
        pixel_m,
        ..
    } = *point;
    let GroundNoise { fine, mid, coarse } = *point.noise;
    let (base, rows, period) = crop(hash2(patch.seed, 3), season);
    let headland =
        patch.seed & 0x300 != 0 && at.depth < 5.0 + 3.0 * unit(patch.seed.rotate_left(3));
    let across = if headland { at.depth } else { at.local.y };
    let wavelength = period * (0.7 + 0.6 * unit(patch.seed));
    let seen = ((wavelength / pixel_m - 1.6) * 0.6).clamp(0.0, 1.0);
    let wobble = 0.25
        * fbm(
            at.local.x * 0.6,
            at.local.y * 0.15 + unit(patch.seed) * 300.0,
        );
    // Rows fade in and out with the soil and the crop's vigour.
    let vigour = (0.55 + 0.9 * mid + 0.6 * coarse).clamp(0.1, 1.2);
    let row =
        (std::f32::consts::TAU * (across + wobble) / wavelength).cos() * rows * 0.4 * seen * vigour;
    // Bands of drilling or harvesting, 12 m wide, each a little different.
    let band = hash_cell(patch.seed, (at.local.y / 12.0).floor() as i32, 1);
    let banded = if headland {
        0.0
    } else {
        0.07 * (unit(band) - 0.5)
    };
    // Tramlines.
    let tram = (across + 6.0).rem_euclid(24.0);
    let wheel = (tram - 11.1).abs().min((tram - 12.9).abs());
    let tramline = if wheel < 0.3 && rows < 0.3 {
        -0.13
    } else {
        0.0
    };
    // Soil and moisture, the same in every season: wet hollows, sandy spots, old streams.
    let soil = 0.20 * coarse + 0.10 * mid + 0.10 * (1.0 - (coarse * 5.0 + mid).abs()).max(0.0);
    let thin = (coarse * 1.4 + mid * 0.8 - 0.55).clamp(0.0, 0.7);
    let ground = rgb8(142, 118, 90);
    let tone = 1.0 + row + banded + tramline + soil + 0.10 * fine;
    let edge = ((1.2 - at.depth) * 0.8 + 0.3 * fine).clamp(0.0, 1.0);
    let crop_colour = toned(base.mix(ground, thin * 0.8), tone);
    (
        crop_colour.mix(
            toned(grass(season, 0.5 + 0.3 * mid), 1.0 + 0.2 * fine),
            edge,
        ),
        60,
    )
}
