//! Noise from small tables: fractal noise without repetition within a world, and periodic foliage clumps.

use std::sync::LazyLock;

use wide::{f32x8, i32x8};

use crate::random::{hash_cell, unit};

const SIDE: usize = 512;
const MASK: i32 = SIDE as i32 - 1;

/// Height and slope of many overlapping balls, which resemble foliage from above.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Clump {
    /// 0 in the gaps, 1 on top.
    pub(crate) height: f32,
    /// Slope of the surface along x and y, about -1 to 1.
    pub(crate) slope: [f32; 2],
}

struct Tables {
    /// Values at the four corners of each cell, -127 to 127, from the low byte on: top left, top right, bottom left, bottom right.
    white: Vec<i32>,
    clump: Vec<[i8; 3]>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(|| Tables {
    white: bake_white(),
    clump: bake_clumps(),
});

/// How each octave of [`fbm`] reads the white table: turned and stretched. Each is rotated by another angle, so that their
/// periods never coincide. Lanes without an octave have no weight.
struct Octaves {
    /// Cosine and sine of the turn over the octave's wavelength: table points per unit.
    cos: f32x8,
    sin: f32x8,
    /// Where the table begins, table points.
    start_x: f32x8,
    start_y: f32x8,
    weight: f32x8,
}

const OCTAVES: usize = 6;

const WHITE: Octaves = Octaves::of([
    (64.0, 0.8, [0.9689, 0.2474], 11.3),
    (32.0, 0.8, [0.7373, 0.6755], 97.1),
    (16.0, 0.7, [-0.4161, 0.9093], 203.7),
    (8.0, 0.6, [0.2675, -0.9636], 311.9),
    (4.0, 0.5, [-0.8391, -0.5440], 401.3),
    (2.0, 0.45, [0.5403, 0.8415], 467.7),
]);

impl Octaves {
    /// Wavelength, weight, turn and start of each.
    const fn of(octaves: [(f32, f32, [f32; 2], f32); OCTAVES]) -> Self {
        let [mut cos, mut sin, mut start_x, mut start_y, mut weight] = [[0.0; 8]; 5];
        let mut i = 0;
        while i < OCTAVES {
            let (wavelength, share, turn, start) = octaves[i];
            (cos[i], sin[i]) = (turn[0] / wavelength, turn[1] / wavelength);
            (start_x[i], start_y[i]) = (start, 1.7 * start);
            weight[i] = share * (74.0 / 127.0 / 127.0);
            i += 1;
        }
        Self {
            cos: f32x8::new(cos),
            sin: f32x8::new(sin),
            start_x: f32x8::new(start_x),
            start_y: f32x8::new(start_y),
            weight: f32x8::new(weight),
        }
    }
}

fn smooth(t: f32x8) -> f32x8 {
    t * t * (3.0 - 2.0 * t)
}

fn bake_white() -> Vec<i32> {
    let value = |x: i32, y: i32| {
        let random = unit(hash_cell(11, x & MASK, y & MASK));
        ((random * 2.0 - 1.0) * 127.0) as i8
    };
    let corners = |x: i32, y: i32| [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
    let side = SIDE as i32;
    let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
    cells
        .map(|(x, y)| {
            let bytes = corners(x, y).map(|(x, y)| value(x, y).cast_unsigned());
            i32::from_le_bytes(bytes)
        })
        .collect()
}

fn bake_clumps() -> Vec<[i8; 3]> {
    // Balls of two sizes on jittered lattices; the upper envelope is the surface.
    let mut height = vec![0.0_f32; SIDE * SIDE];
    for (seed, cell, lift) in [(71_u32, 32_i32, 0.35_f32), (72, 16, 0.18), (73, 16, 0.0)] {
        let cells = SIDE as i32 / cell;
        for cy in 0..cells {
            for cx in 0..cells {
                let h = hash_cell(seed, cx, cy);
                let px = (cx as f32 + unit(h)) * cell as f32;
                let py = (cy as f32 + unit(h.rotate_left(11))) * cell as f32;
                let radius = cell as f32 * (0.55 + 0.4 * unit(h.rotate_left(22)));
                let reach = radius.ceil() as i32;
                for dy in -reach..=reach {
                    for dx in -reach..=reach {
                        let (qx, qy) = (px as i32 + dx, py as i32 + dy);
                        let d2 = (qx as f32 - px).powi(2) + (qy as f32 - py).powi(2);
                        let inside = 1.0 - d2 / (radius * radius);
                        if inside > 0.0 {
                            let ball = lift * unit(h.rotate_left(5)) + (1.0 - lift) * inside.sqrt();
                            let at = (qy & MASK) as usize * SIDE + (qx & MASK) as usize;
                            height[at] = height[at].max(ball);
                        }
                    }
                }
            }
        }
    }
    let at = |x: i32, y: i32| height[(y & MASK) as usize * SIDE + (x & MASK) as usize];
    let quantise = |v: f32| (v * 127.0).clamp(-127.0, 127.0) as i8;
    let mut table = Vec::with_capacity(SIDE * SIDE);
    for y in 0..SIDE as i32 {
        for x in 0..SIDE as i32 {
            let slope_x = (at(x + 1, y) - at(x - 1, y)) * 4.0;
            let slope_y = (at(x, y + 1) - at(x, y - 1)) * 4.0;
            table.push([quantise(at(x, y)), quantise(slope_x), quantise(slope_y)]);
        }
    }
    table
}

/// `floor` as an integer and a float; the library's is a call on baseline x86-64.
#[inline]
pub(crate) fn split_floor(x: f32) -> (i32, f32) {
    let cut = x as i32;
    let whole = cut - i32::from((cut as f32) > x);
    (whole, whole as f32)
}

/// The whole part of each number, rounded down, and what is above it.
#[inline]
fn split_floors(x: f32x8) -> (i32x8, f32x8) {
    let cut = x.fast_trunc_int();
    let cut_f = f32x8::from_i32x8(cut);
    let one_less = cut_f.simd_gt(x) & f32x8::splat(1.0);
    (cut - one_less.fast_trunc_int(), x - (cut_f - one_less))
}

struct Corners {
    at: [usize; 4],
    u: f32,
    v: f32,
}

#[inline]
fn corners(x: f32, y: f32) -> Corners {
    let ((ix, fx), (iy, fy)) = (split_floor(x), split_floor(y));
    let (x0, x1) = ((ix & MASK) as usize, ((ix + 1) & MASK) as usize);
    let (y0, y1) = (
        (iy & MASK) as usize * SIDE,
        ((iy + 1) & MASK) as usize * SIDE,
    );
    Corners {
        at: [y0 + x0, y0 + x1, y1 + x0, y1 + x1],
        u: x - fx,
        v: y - fy,
    }
}

/// Fractal value noise, about -1 to 1 (deviation about 0.35); features from 2 to 64 units. The octaves are independent, so that
/// no place within many thousand units looks like another.
#[inline]
pub(crate) fn fbm(x: f32, y: f32) -> f32 {
    let (x, y) = (f32x8::splat(x), f32x8::splat(y));
    let (column, u) = split_floors(x * WHITE.cos - y * WHITE.sin + WHITE.start_x);
    let (row, v) = split_floors(x * WHITE.sin + y * WHITE.cos + WHITE.start_y);
    let mask = i32x8::splat(MASK);
    let cells = ((row & mask) << SIDE.ilog2()) | (column & mask);
    let white = &TABLES.white;
    let mut corners = [0; 8];
    for (corners, cell) in corners.iter_mut().zip(&cells.to_array()[..OCTAVES]) {
        *corners = white[*cell as usize];
    }
    let corners = i32x8::new(corners);
    let corner = |number: u32| f32x8::from_i32x8((corners << (24 - 8 * number)) >> 24_u32);
    let (u, v) = (smooth(u), smooth(v));
    let top = corner(0) + (corner(1) - corner(0)) * u;
    let bottom = corner(2) + (corner(3) - corner(2)) * u;
    let octaves = WHITE.weight * (top + (bottom - top) * v);
    // In this order on every processor.
    let sum: f32 = octaves.to_array()[..OCTAVES].iter().sum();
    sum.clamp(-1.0, 1.0)
}

/// Foliage clumps, period 512 along each axis; balls of 9 to 30 units radius.
#[inline]
pub(crate) fn clump(x: f32, y: f32) -> Clump {
    let Corners { at, u, v } = corners(x, y);
    let corners = at.map(|i| TABLES.clump[i]);
    let lerp = |k: usize| {
        let [a, b, c, d] = corners.map(|corner| f32::from(corner[k]));
        let top = a + (b - a) * u;
        let bottom = c + (d - c) * u;
        (top + (bottom - top) * v) * (1.0 / 127.0)
    };
    Clump {
        height: lerp(0),
        slope: [lerp(1), lerp(2)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fbm_is_centred_and_varied() {
        let n = 4000;
        let values: Vec<f32> = (0..n)
            .map(|i| fbm(i as f32 * 7.37, i as f32 * 3.11))
            .collect();
        let mean = values.iter().sum::<f32>() / n as f32;
        let var = values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n as f32;
        assert!(mean.abs() < 0.06, "mean {mean}");
        assert!(
            var.sqrt() > 0.2 && var.sqrt() < 0.5,
            "deviation {}",
            var.sqrt()
        );
    }

    #[test]
    fn fbm_does_not_come_back() {
        let patch = |left: f32, top: f32| -> Vec<f32> {
            let points = (0..32).flat_map(|y| (0..32).map(move |x| (x, y)));
            points
                .map(|(x, y)| fbm(left + 3.0 * x as f32, top + 3.0 * y as f32))
                .collect()
        };
        let correlation = |a: &[f32], b: &[f32]| {
            let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
            let (ma, mb) = (mean(a), mean(b));
            let dot = |a: &[f32], ma: f32, b: &[f32], mb: f32| -> f32 {
                a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum()
            };
            dot(a, ma, b, mb) / (dot(a, ma, a, ma) * dot(b, mb, b, mb)).sqrt()
        };
        let here = patch(100.0, 50.0);
        assert!(correlation(&here, &patch(100.0, 50.0)) > 0.999);
        for i in -8..=8 {
            for j in -8..=8_i32 {
                if (i, j) != (0, 0) {
                    let there = patch(100.0 + 512.0 * i as f32, 50.0 + 512.0 * j as f32);
                    let c = correlation(&here, &there);
                    assert!(c.abs() < 0.6, "{c} at {i}, {j}");
                }
            }
        }
    }

    #[test]
    fn clump_slope_is_the_derivative_of_its_height() {
        let (mut agree, mut total) = (0, 0);
        for i in 0..2000 {
            let (x, y) = ((i * 13 % 509) as f32, (i * 29 % 503) as f32);
            let rise = clump(x + 1.0, y).height - clump(x - 1.0, y).height;
            let slope = clump(x, y).slope[0];
            if rise.abs() > 0.03 {
                total += 1;
                agree += usize::from(rise.signum() == slope.signum());
            }
        }
        assert!(total > 100 && agree * 20 > total * 19, "{agree} of {total}");
    }
}
