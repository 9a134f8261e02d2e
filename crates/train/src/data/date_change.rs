//! Differences between two dates of one place: snow, uneven light, lost resolution, ground that was rebuilt.
//!
//! All functions work on interleaved RGB in 0..1 and keep the picture's size, so that points stay where they are; rebuilt ground has none.

use rand::Rng;

use super::filters::{gaussian, sharpen};

/// A smooth field between 0 and 1: bilinear interpolation of `cells x cells` uniform random numbers.
fn smooth_field(width: usize, height: usize, cells: usize, random: &mut impl Rng) -> Vec<f32> {
    let nodes = cells + 1;
    let values: Vec<f32> = (0..nodes * nodes).map(|_| random.random()).collect();
    let mut field = Vec::with_capacity(width * height);
    for y in 0..height {
        let v = y as f32 * cells as f32 / height as f32;
        let (row, fy) = (v as usize, v.fract());
        for x in 0..width {
            let u = x as f32 * cells as f32 / width as f32;
            let (column, fx) = (u as usize, u.fract());
            let at = |i: usize, j: usize| values[(row + j) * nodes + column + i];
            let top = at(0, 0) * (1.0 - fx) + at(1, 0) * fx;
            let bottom = at(0, 1) * (1.0 - fx) + at(1, 1) * fx;
            field.push(top * (1.0 - fy) + bottom * fy);
        }
    }
    field
}

/// Covers the ground with snow: all of it or patches, less on what is dark (asphalt, water, walls in shadow).
pub(super) fn snow(pixels: &mut [f32], width: usize, height: usize, random: &mut impl Rng) {
    let cells = random.random_range(2..9);
    let field = smooth_field(width, height, cells, random);
    let cover = random.random_range(-0.2..0.7);
    let clears_dark = random.random_range(0.0..1.0);
    let most = random.random_range(0.55..0.95);
    let snow = [
        random.random_range(0.78..0.95),
        random.random_range(0.8..0.95),
        random.random_range(0.85..1.0),
    ];
    for (p, place) in pixels.chunks_exact_mut(3).zip(field) {
        let grey = 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2];
        let lies = ((place - cover) * 4.0).clamp(0.0, 1.0);
        let stays = 1.0 - clears_dark * (1.0 - grey * 2.5).clamp(0.0, 1.0);
        let share = most * lies * stays;
        for c in 0..3 {
            // Relief and shadows remain visible in the snow.
            let shaded = snow[c] * (0.7 + 0.5 * grey).min(1.05);
            p[c] += (shaded - p[c]) * share;
        }
    }
}

/// Multiplies the light by a smooth field, as shadows of clouds, vignetting and the seams of mosaics do.
pub(super) fn uneven_light(pixels: &mut [f32], width: usize, height: usize, random: &mut impl Rng) {
    let cells = random.random_range(1..6);
    let field = smooth_field(width, height, cells, random);
    let strength = random.random_range(0.2..0.9);
    // A hard edge every other time: the shadow of a cloud rather than a gradient.
    let edge = if random.random_bool(0.5) { 8.0 } else { 1.0 };
    let threshold = random.random_range(0.3..0.7);
    for (p, place) in pixels.chunks_exact_mut(3).zip(field) {
        let shadow = ((place - threshold) * edge + 0.5).clamp(0.0, 1.0);
        let gain = 1.0 - strength * shadow + 0.3 * strength * (1.0 - shadow);
        for (c, v) in p.iter_mut().enumerate() {
            *v *= gain * (1.0 + 0.06 * c as f32 * shadow * strength);
        }
    }
}

/// Loses resolution as a coarser sensor does (blur, fewer pixels), and may sharpen what is left as map services do.
pub(super) fn coarsen(pixels: &mut [f32], width: usize, height: usize, random: &mut impl Rng) {
    let factor = random.random_range(1.3..3.0);
    gaussian(pixels, width, height, 0.45 * factor);
    let (small_w, small_h) = (
        ((width as f32 / factor) as usize).max(8),
        ((height as f32 / factor) as usize).max(8),
    );
    let before = pixels.to_vec();
    let small: Vec<[f32; 3]> = (0..small_w * small_h)
        .map(|i| {
            let x = ((i % small_w) as f32 + 0.5) * width as f32 / small_w as f32 - 0.5;
            let y = ((i / small_w) as f32 + 0.5) * height as f32 / small_h as f32 - 0.5;
            sample(&before, width, height, x, y)
        })
        .collect();
    let small: Vec<f32> = small.into_iter().flatten().collect();
    for y in 0..height {
        for x in 0..width {
            let u = (x as f32 + 0.5) * small_w as f32 / width as f32 - 0.5;
            let v = (y as f32 + 0.5) * small_h as f32 / height as f32 - 0.5;
            let at = (y * width + x) * 3;
            pixels[at..at + 3].copy_from_slice(&sample(&small, small_w, small_h, u, v));
        }
    }
    if random.random_bool(0.5) {
        sharpen(pixels, width, height, random.random_range(0.5..2.0));
    }
}

/// Bilinear sample, edges repeated.
fn sample(pixels: &[f32], width: usize, height: usize, x: f32, y: f32) -> [f32; 3] {
    let x = x.clamp(0.0, (width - 1) as f32);
    let y = y.clamp(0.0, (height - 1) as f32);
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (fx, fy) = (x - left as f32, y - top as f32);
    std::array::from_fn(|c| {
        let at = |x: usize, y: usize| pixels[(y * width + x) * 3 + c];
        (at(left, top) * (1.0 - fx) + at(right, top) * fx) * (1.0 - fy)
            + (at(left, bottom) * (1.0 - fx) + at(right, bottom) * fx) * fy
    })
}

/// Replaces some rectangles of any direction by ground from elsewhere in the picture, mirrored: built, demolished or replanted between the
/// dates. Returns for each pixel whether it shows such ground, if only in part.
pub(super) fn rebuild(
    pixels: &mut [f32],
    width: usize,
    height: usize,
    random: &mut impl Rng,
) -> Vec<bool> {
    let before = pixels.to_vec();
    let mut rebuilt = vec![false; width * height];
    for _ in 0..random.random_range(1..7) {
        let half = [
            random.random_range(0.02..0.11) * width as f32,
            random.random_range(0.02..0.11) * width as f32,
        ];
        let centre = [
            random.random_range(0.0..width as f32),
            random.random_range(0.0..height as f32),
        ];
        let from = [
            random.random_range(0.2..0.8) * width as f32,
            random.random_range(0.2..0.8) * height as f32,
        ];
        let (sin, cos) = random.random_range(0.0..std::f32::consts::PI).sin_cos();
        let soft = random.random_range(0.5..3.0);
        let reach = half[0] + half[1];
        let rows =
            (centre[1] - reach).max(0.0) as usize..((centre[1] + reach) as usize + 1).min(height);
        for y in rows {
            let columns = (centre[0] - reach).max(0.0) as usize
                ..((centre[0] + reach) as usize + 1).min(width);
            for x in columns {
                let (dx, dy) = (x as f32 - centre[0], y as f32 - centre[1]);
                let (u, v) = (cos * dx + sin * dy, cos * dy - sin * dx);
                let outside = (u.abs() - half[0]).max(v.abs() - half[1]);
                let share = (0.5 - outside / soft).clamp(0.0, 1.0);
                if share > 0.0 {
                    let there = sample(&before, width, height, from[0] - dx, from[1] + dy);
                    let p = &mut pixels[(y * width + x) * 3..][..3];
                    for c in 0..3 {
                        p[c] += (there[c] - p[c]) * share;
                    }
                    rebuilt[y * width + x] = true;
                }
            }
        }
    }
    rebuilt
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn picture() -> Vec<f32> {
        (0..48 * 40)
            .flat_map(|i| [(i % 48) as f32 / 48.0, (i / 48) as f32 / 40.0, 0.3])
            .collect()
    }

    #[test]
    fn each_change_changes_the_picture_and_keeps_it_finite() {
        type Change = fn(&mut [f32], usize, usize, &mut ChaCha8Rng);
        let changes: [(&str, Change); 4] = [
            ("snow", snow),
            ("uneven_light", uneven_light),
            ("coarsen", coarsen),
            ("rebuild", |pixels, width, height, random| {
                rebuild(pixels, width, height, random);
            }),
        ];
        for (name, change) in changes {
            for seed in 0..8 {
                let mut pixels = picture();
                change(&mut pixels, 48, 40, &mut ChaCha8Rng::seed_from_u64(seed));
                assert_ne!(pixels, picture(), "{name}");
                assert!(pixels.iter().all(|v| v.is_finite()), "{name}");
            }
        }
    }

    #[test]
    fn coarsening_keeps_the_mean_and_loses_detail() {
        let checker: Vec<f32> = (0..64 * 64)
            .flat_map(|i| [((i % 64 + i / 64) % 2) as f32; 3])
            .collect();
        let mut pixels = checker.clone();
        coarsen(&mut pixels, 64, 64, &mut ChaCha8Rng::seed_from_u64(3));
        let mean = |p: &[f32]| p.iter().sum::<f32>() / p.len() as f32;
        let deviation = |p: &[f32]| {
            let m = mean(p);
            (p.iter().map(|v| (v - m).powi(2)).sum::<f32>() / p.len() as f32).sqrt()
        };
        assert!((mean(&pixels) - 0.5).abs() < 0.03);
        assert!(deviation(&pixels) < 0.25 * deviation(&checker));
    }

    #[test]
    fn snow_brightens_and_rebuilt_ground_is_a_small_part() {
        let dark = vec![0.35; 64 * 64 * 3];
        let mut brighter = 0;
        for seed in 0..20 {
            let mut pixels = dark.clone();
            snow(&mut pixels, 64, 64, &mut ChaCha8Rng::seed_from_u64(seed));
            brighter += usize::from(pixels.iter().sum::<f32>() > dark.iter().sum::<f32>());
        }
        assert!(brighter >= 18, "{brighter} of 20");
        let noise: Vec<f32> = (0..64 * 64 * 3)
            .map(|i| (i * 7919 % 101) as f32 / 101.0)
            .collect();
        let mut changed = 0;
        for seed in 0..20 {
            let mut pixels = noise.clone();
            let rebuilt = rebuild(&mut pixels, 64, 64, &mut ChaCha8Rng::seed_from_u64(seed));
            let both = pixels.chunks_exact(3).zip(noise.chunks_exact(3));
            for ((now, before), rebuilt) in both.zip(rebuilt) {
                assert!(rebuilt || now == before);
            }
            changed += pixels.iter().zip(&noise).filter(|(a, b)| a != b).count();
        }
        let share = changed as f64 / (20 * noise.len()) as f64;
        assert!((0.01..0.35).contains(&share), "{share}");
    }
}
