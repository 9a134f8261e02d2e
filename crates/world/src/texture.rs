//! The colour of the ground at every point: each cover's texture, at several scales.

use nalgebra::Vector2;

use crate::colour::{Rgb, rgb8};
use crate::cover::{Cover, Inside, Patch};
use crate::look::Season;
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
    /// `pixel_m` fades what the picture cannot resolve.
    #[inline]
    pub(crate) fn at(p: V2, pixel_m: f32) -> Self {
        Self {
            fine: fbm(p.x * 8.3 + p.y * 2.1, p.y * 8.3 - p.x * 2.1) * (0.22 / pixel_m).min(1.2),
            mid: fbm(p.x * 1.5 - p.y * 0.7 + 91.0, p.y * 1.5 + p.x * 0.7),
            coarse: fbm(p.x * 0.17 + p.y * 0.04, p.y * 0.17 - p.x * 0.04 + 57.0),
        }
    }
}

/// Grass from dry (0) to lush (1).
pub(crate) fn grass(season: Season, lush: f32) -> Rgb {
    let (dry, wet) = match season {
        Season::Spring => (rgb8(128, 138, 78), rgb8(84, 122, 46)),
        Season::Summer => (rgb8(146, 138, 88), rgb8(80, 104, 46)),
        Season::Autumn => (rgb8(146, 132, 86), rgb8(92, 104, 52)),
        Season::Winter => (rgb8(138, 124, 96), rgb8(98, 100, 68)),
    };
    dry.mix(wet, lush.clamp(0.0, 1.0))
}

/// Colour of a crop and how strongly its rows show.
fn crop(seed: u32, season: Season) -> (Rgb, f32, f32) {
    const BARE: [Rgb; 4] = [
        rgb8(126, 100, 74),
        rgb8(108, 86, 66),
        rgb8(146, 122, 94),
        rgb8(120, 104, 88),
    ];
    let bare = BARE[(seed >> 5 & 3) as usize];
    // (colour, row amplitude, row period in metres)
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

/// Small things lying or growing about: a factor on the colour. The same in every picture.
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
fn winding(p: V2, scale: f32, width_m: f32, shift: f32) -> f32 {
    let value = fbm(p.x * scale + shift, p.y * scale - shift);
    // The noise's slope is about 0.2 per table unit.
    (1.5 - value.abs() / (width_m * scale * 0.12)).clamp(0.0, 1.0)
}

/// Display-like tone change that stays positive.
#[inline]
fn toned(colour: Rgb, tone: f32) -> Rgb {
    let t = tone.max(0.2);
    colour * (t * t)
}

/// Linear colour of a patch at a point. `pixel_m` is the size of a picture element on the ground.
pub(crate) fn patch_albedo(
    patch: &Patch,
    at: &Inside,
    p: V2,
    noise: &GroundNoise,
    season: Season,
    pixel_m: f32,
) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *noise;
    let seed = patch.seed;
    let local = at.local;
    let resolved = |period: f32| ((period / pixel_m - 1.6) * 0.8).clamp(0.0, 1.0);
    let stripe = |x: f32, period: f32, width: f32| x.rem_euclid(period) < width;
    match patch.cover {
        Cover::Lawn => {
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
        Cover::Meadow => {
            let lush = 0.45 + 0.55 * coarse + 0.4 * mid;
            let tussock = if fine + mid > 0.75 { 0.82 } else { 1.0 };
            let trail = winding(p, 0.33, 0.5, unit(seed) * 300.0) * (0.5 + mid).clamp(0.0, 0.8);
            let green = grass(season, lush).mix(rgb8(158, 138, 106), trail);
            (toned(green, (1.0 + 0.18 * fine + 0.12 * mid) * tussock), 17)
        }
        Cover::Crop => crop_albedo(patch, at, noise, season, pixel_m),
        Cover::Orchard => {
            let strip = (local.y / 4.5 - 0.5).rem_euclid(1.0);
            let bare = ((0.16 - (strip - 0.5).abs()) * 8.0).clamp(0.0, 1.0);
            let soil = toned(rgb8(138, 116, 88), 1.0 + 0.15 * fine);
            let g = toned(
                grass(season, 0.5 + 0.4 * mid + 0.3 * coarse),
                1.0 + 0.15 * fine,
            );
            (g.mix(soil, bare * 0.8), 18)
        }
        Cover::ForestFloor => {
            let litter = match season {
                Season::Summer | Season::Spring => rgb8(62, 64, 40),
                _ => rgb8(104, 84, 62),
            };
            (toned(litter, 1.0 + 0.3 * fine + 0.2 * mid), 19)
        }
        Cover::Garden => {
            // A patchwork: lawn, beds, bushes' shade, bits of paving.
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
        Cover::Allotment => {
            let cell = V2::new((local.x / 9.0).floor(), (local.y / 1.9).floor());
            let h = hash_cell(seed, cell.x as i32, cell.y as i32);
            let (colour, ..) = crop(h, season);
            let path = stripe(local.x, 9.0, 0.8) || stripe(local.y, 1.9, 0.35);
            let base = if path { rgb8(140, 124, 100) } else { colour };
            (
                toned(base, 0.95 + 0.2 * unit(h.rotate_left(7)) + 0.2 * fine),
                24 + (h & 7),
            )
        }
        Cover::Asphalt => (asphalt(seed, local, noise), 32),
        Cover::Stalls => {
            let base = asphalt(seed, local, noise);
            let row = (local.y + patch.half.y).rem_euclid(16.5);
            let in_bay = !(5.0..=11.5).contains(&row);
            let line =
                in_bay && stripe(local.x + patch.half.x, 2.6, 0.14) || (row - 16.2).abs() < 0.08;
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
        Cover::Concrete => {
            let tone = 1.0 + 0.10 * fine + 0.14 * mid + 0.10 * coarse;
            let joint = stripe(local.x, 5.0, 0.12) || stripe(local.y, 5.0, 0.12);
            let slab = hash_cell(
                seed,
                (local.x / 5.0).floor() as i32,
                (local.y / 5.0).floor() as i32,
            );
            let tone = tone * (0.93 + 0.14 * unit(slab)) * if joint { 0.84 } else { 1.0 };
            let base = rgb8(150, 148, 142).mix(rgb8(188, 180, 166), unit(seed));
            (toned(base, tone), 35)
        }
        Cover::Slabs => {
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
                    0.92 + 0.14 * unit(h) * resolved(1.6) + 0.1 * fine + 0.08 * mid,
                ),
                36,
            )
        }
        Cover::Gravel => {
            let base = rgb8(166, 158, 144).mix(rgb8(134, 124, 110), unit(seed));
            (toned(base, 1.0 + 0.16 * fine + 0.14 * mid), 37)
        }
        Cover::Dirt => {
            let base = rgb8(150, 126, 96).mix(rgb8(120, 98, 74), 0.5 + 0.6 * mid);
            let weeds = ((coarse + 0.7 * mid + 0.4 * fine) * 2.0 - 0.4).clamp(0.0, 0.8);
            (
                toned(base.mix(grass(season, 0.4), weeds), 1.0 + 0.18 * fine),
                38,
            )
        }
        Cover::Sand => (
            toned(rgb8(204, 188, 152), 1.0 + 0.08 * fine + 0.08 * mid),
            39,
        ),
        Cover::Water => {
            let shallow = (1.0 - at.depth / 4.0 + 0.5 * mid).clamp(0.0, 1.0);
            let deep = match seed & 3 {
                0 => rgb8(38, 54, 56),
                1 => rgb8(56, 66, 52),
                _ => rgb8(46, 58, 48),
            };
            if at.depth < 1.1 + 0.8 * mid {
                return (toned(rgb8(122, 112, 88), 1.0 + 0.2 * fine), 40);
            }
            let ripple = 1.0 + 0.05 * fine + 0.06 * mid;
            (toned(deep.mix(rgb8(92, 94, 66), shallow * 0.8), ripple), 41)
        }
        Cover::Pool => {
            if at.depth < 0.5 {
                return (rgb8(206, 200, 190), 42);
            }
            let ripple = 1.0 + 0.05 * (fbm(p.x * 60.0, p.y * 60.0)) * resolved(0.5);
            (
                toned(
                    rgb8(70, 170, 190).mix(rgb8(52, 140, 180), unit(seed)),
                    ripple,
                ),
                43,
            )
        }
        Cover::Pitch => (
            pitch(patch, at, noise, season),
            44 + u32::from(at.depth < 1.0),
        ),
        Cover::Court => {
            let h = patch.half;
            let c = local.abs();
            let line = (c.x - (h.x - 3.0)).abs() < 0.07 && c.y < h.y - 2.0
                || (c.y - (h.y - 2.0)).abs() < 0.07 && c.x < h.x - 3.0
                || c.x < 0.07 && c.y < h.y - 2.0
                || (c.y - (h.y - 4.4)).abs() < 0.06 && c.x < h.x - 3.0;
            let (inner, outer) = match seed & 3 {
                0 => (rgb8(156, 84, 64), rgb8(86, 116, 84)),
                1 => (rgb8(62, 98, 140), rgb8(78, 124, 92)),
                2 => (rgb8(72, 116, 86), rgb8(150, 86, 66)),
                _ => (rgb8(176, 108, 74), rgb8(176, 108, 74)),
            };
            let playing = c.x < h.x - 3.0 && c.y < h.y - 2.0;
            let tone = 1.0 + 0.06 * fine + 0.08 * mid;
            if line {
                (rgb8(226, 226, 222), 46)
            } else {
                (
                    toned(if playing { inner } else { outer }, tone),
                    47 + u32::from(playing),
                )
            }
        }
        Cover::Track => track(patch, local, noise, season),
        Cover::Ballast => {
            let tone = 1.0 + 0.18 * fine + 0.08 * mid;
            let side = local.y.abs();
            // Two tracks, 1.435 m gauge.
            let off = (side - 2.1).abs();
            if (off - 0.72).abs() < 0.09 {
                return (rgb8(150, 142, 136), 50);
            }
            let tie = off < 1.3 && stripe(local.x, 0.65, 0.26);
            let base = if tie {
                rgb8(112, 106, 100)
            } else {
                rgb8(134, 122, 112)
            };
            let weeds = ((1.0 - at.depth) + 0.6 * mid).clamp(0.0, 0.8);
            (toned(base.mix(grass(season, 0.4), weeds), tone), 51)
        }
        Cover::Graves => {
            let cell = V2::new((local.x / 2.6).floor(), (local.y / 1.5).floor());
            let h = hash_cell(seed, cell.x as i32, cell.y as i32);
            let (fx, fy) = (local.x.rem_euclid(2.6), local.y.rem_euclid(1.5));
            let path = stripe(local.x, 23.4, 2.4) || stripe(local.y, 18.0, 1.8);
            if path {
                return (toned(rgb8(168, 156, 136), 1.0 + 0.12 * fine), 52);
            }
            if (0.3..2.2).contains(&fx) && (0.25..1.1).contains(&fy) && h % 10 < 8 {
                let stone = rgb8(90, 88, 90).mix(rgb8(190, 186, 178), unit(h));
                return (toned(stone, 1.0 + 0.1 * fine), 53);
            }
            (toned(grass(season, 0.5 + 0.4 * mid), 1.0 + 0.15 * fine), 54)
        }
        Cover::Site => {
            let base = rgb8(178, 150, 112).mix(rgb8(140, 112, 84), 0.5 + 0.8 * mid);
            let rut = fbm(local.x * 0.8 + 9.0, local.y * 6.0);
            (
                toned(base, 1.0 + 0.18 * fine + 0.14 * rut + 0.15 * coarse),
                55,
            )
        }
    }
}

fn asphalt(seed: u32, local: V2, noise: &GroundNoise) -> Rgb {
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

fn crop_albedo(
    patch: &Patch,
    at: &Inside,
    noise: &GroundNoise,
    season: Season,
    pixel_m: f32,
) -> (Rgb, u32) {
    let GroundNoise { fine, mid, coarse } = *noise;
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

fn pitch(patch: &Patch, at: &Inside, noise: &GroundNoise, season: Season) -> Rgb {
    let h = patch.half;
    let l = at.local;
    let c = l.abs();
    let mown = if ((l.x / 5.5).floor() as i32) & 1 == 0 {
        0.07
    } else {
        -0.07
    };
    let worn = ((0.35 - ((c.x - h.x + 6.0) / 9.0).hypot(l.y / 7.0) * 0.3) + 0.3 * noise.mid)
        .clamp(0.0, 0.55);
    let g = grass(season, 0.75 + 0.3 * noise.coarse + 0.25 * noise.mid + mown);
    let ground = toned(
        g.mix(rgb8(150, 128, 92), worn),
        1.0 + mown * 0.5 + 0.1 * noise.fine,
    );
    let line = |d: f32| d.abs() < 0.09;
    let (ex, ey) = (h.x - 2.0, h.y - 2.0);
    let in_field = c.x < ex + 0.1 && c.y < ey + 0.1;
    let ring = l.norm();
    let box_x = c.x - (ex - 16.5);
    let marked = in_field
        && (line(c.x - ex)
            || line(c.y - ey)
            || line(l.x)
            || line(ring - 9.15)
            || line(box_x) && c.y < 20.15
            || line(c.y - 20.15) && box_x > 0.0);
    if marked {
        ground.mix(rgb8(230, 232, 226), 0.8)
    } else {
        ground
    }
}

fn track(patch: &Patch, local: V2, noise: &GroundNoise, season: Season) -> (Rgb, u32) {
    // A stadium shape: straights along u, half circles at the ends, six lanes.
    let radius = patch.half.y;
    let straight = (patch.half.x - radius).max(0.0);
    let over = (local.x.abs() - straight).max(0.0);
    let r = over.hypot(local.y);
    let inner = radius - 7.4;
    if r < inner || r > radius {
        let lush = 0.6 + 0.4 * noise.mid + 0.3 * noise.coarse;
        return (
            toned(grass(season, lush), 1.0 + 0.1 * noise.fine),
            56 + u32::from(r > radius),
        );
    }
    let lane = (r - inner).rem_euclid(1.22);
    let colour = if patch.seed & 3 == 0 {
        rgb8(88, 104, 150)
    } else {
        rgb8(164, 84, 66)
    };
    if lane < 0.08 || local.x.abs() < 0.1 && local.y > 0.0 {
        return (rgb8(216, 206, 198), 58);
    }
    (
        toned(colour, 1.0 + 0.06 * noise.fine + 0.08 * noise.mid),
        59,
    )
}
