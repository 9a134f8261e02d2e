//! Photometric changes: the same place under another sensor and at another time.

use super::date_change::{coarsen, rebuild, snow, uneven_light};
use super::filters::{gaussian, sharpen};
use super::sensor_change::{filter_randomly, mix_low_frequencies};
use grimnet_net::Domain;
use image::RgbImage;
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Range of the photometric changes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Look {
    /// Strength for map views, 0 to 1.
    pub sat_strength: f32,
    /// Strength for photos, 0 to 1.
    pub uav_strength: f32,
    /// Share of map views with histogram equalisation.
    pub equalised: f64,
    /// Share of map views with local contrast normalisation, as map services use.
    pub locally_equalised: f64,
    /// Share of photos with added shadows.
    pub shadows: f64,
    /// Share of views with haze.
    pub haze: f64,
    /// Share of views with changed colour of vegetation.
    pub season: f64,
    /// Share of views with JPEG compression.
    pub jpeg: f64,
    /// Share of views under snow.
    pub snow: f64,
    /// Share of views under uneven light: cloud shadows, gradients, seams.
    pub uneven_light: f64,
    /// Share of views that lost resolution, and may have been sharpened afterwards.
    pub coarse: f64,
    /// Share of photos with pieces of ground that were rebuilt.
    pub rebuilt: f64,
    /// Share of views with a random filter over space and colours.
    pub filtered: f64,
    /// Share of views with the low frequencies of another picture of the data.
    pub mixed: f64,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            sat_strength: 0.7,
            uav_strength: 1.0,
            equalised: 0.3,
            locally_equalised: 0.0,
            shadows: 0.45,
            haze: 0.25,
            season: 0.35,
            jpeg: 0.3,
            snow: 0.0,
            uneven_light: 0.0,
            coarse: 0.0,
            rebuilt: 0.0,
            filtered: 0.0,
            mixed: 0.0,
        }
    }
}

/// Whether something that happens to `share` of the views happens to this one. It takes no random number if it never does, so
/// that runs with and without the setting see the same pairs.
fn happens(share: f64, random: &mut impl Rng) -> bool {
    share > 0.0 && random.random_bool(share.min(1.0))
}

/// A uniform random number between the bounds.
fn between(random: &mut impl Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * random.random::<f32>()
}

/// Interleaved RGB in 0..1.
fn floats_of(image: &RgbImage) -> Vec<f32> {
    let values = image.as_raw().iter();
    values.map(|v| f32::from(*v) / 255.0).collect()
}

/// The bytes of [`floats_of`].
fn bytes_of(pixels: &[f32]) -> Vec<u8> {
    let values = pixels.iter();
    values
        .map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
        .collect()
}

/// The photo with pieces of ground that were rebuilt, and for each pixel whether it shows such ground; `None` for photos without
/// ([`Look::rebuilt`]).
pub(super) fn rebuild_ground(
    photo: &RgbImage,
    look: &Look,
    random: &mut impl Rng,
) -> Option<(RgbImage, Vec<bool>)> {
    if !happens(look.rebuilt, random) {
        return None;
    }
    let mut pixels = floats_of(photo);
    let (width, height) = (photo.width() as usize, photo.height() as usize);
    let rebuilt = rebuild(&mut pixels, width, height, random);
    let photo = RgbImage::from_raw(photo.width(), photo.height(), bytes_of(&pixels))?;
    Some((photo, rebuilt))
}

/// Applies random photometric changes to a view. `other` is a view of the same size of another picture, for [`Look::mixed`].
pub fn change_look(
    image: &RgbImage,
    other: Option<&RgbImage>,
    domain: Domain,
    look: &Look,
    random: &mut impl Rng,
) -> RgbImage {
    let k = if domain == Domain::Uav {
        look.uav_strength
    } else {
        look.sat_strength
    };
    let (width, height) = (image.width() as usize, image.height() as usize);
    let mut pixels = floats_of(image);
    if domain == Domain::Uav && happens(look.rebuilt, random) {
        rebuild(&mut pixels, width, height, random);
    }
    if happens(look.snow, random) {
        snow(&mut pixels, width, height, random);
    }
    if random.random_bool(look.season) {
        change_season(&mut pixels, k, random);
    }
    if happens(look.filtered, random) {
        filter_randomly(&mut pixels, width, height, random);
    }
    if let Some(other) = other
        && happens(look.mixed, random)
    {
        mix_low_frequencies(&mut pixels, &floats_of(other), width, height, random);
    }
    if random.random_bool(0.5) {
        change_saturation(&mut pixels, between(random, 1.0 - 0.6 * k, 1.0 + 0.5 * k));
    }
    change_tone(
        &mut pixels,
        k,
        if random.random_bool(look.haze) {
            between(random, 0.05, 0.45)
        } else {
            0.0
        },
        random,
    );
    relight(&mut pixels, [width, height], domain, look, random);
    match random.random_range(0..10) {
        0..4 => gaussian(&mut pixels, width, height, between(random, 0.4, 1.8)),
        4..6 => sharpen(&mut pixels, width, height, between(random, 0.3, 1.5)),
        _ => {}
    }
    add_noise(&mut pixels, between(random, 0.0, 0.05) * k, random);
    let out = RgbImage::from_raw(image.width(), image.height(), bytes_of(&pixels))
        .unwrap_or_else(|| image.clone());
    if random.random_bool(look.jpeg) {
        compressed(out, random.random_range(25..90))
    } else {
        out
    }
}

/// Equalises a map's tones, casts shadows, and takes away light and detail.
fn relight(
    pixels: &mut [f32],
    [width, height]: [usize; 2],
    domain: Domain,
    look: &Look,
    random: &mut impl Rng,
) {
    if domain == Domain::Sat && random.random_bool(look.equalised) {
        equalise(pixels, between(random, 0.5, 1.0));
    }
    if domain == Domain::Sat
        && look.locally_equalised > 0.0
        && random.random_bool(look.locally_equalised)
    {
        let reach = random.random_range(width / 12..width / 4);
        equalise_locally(pixels, width, height, reach, between(random, 0.4, 1.0));
    }
    if random.random_bool(if domain == Domain::Uav {
        look.shadows
    } else {
        look.shadows * 0.4
    }) {
        for _ in 0..random.random_range(1..4) {
            cast_shadow(pixels, width, height, random);
        }
    }
    if happens(look.uneven_light, random) {
        uneven_light(pixels, width, height, random);
    }
    if happens(look.coarse, random) {
        coarsen(pixels, width, height, random);
    }
}

/// Shifts green pixels towards brown or towards deeper green.
fn change_season(pixels: &mut [f32], k: f32, random: &mut impl Rng) {
    let gain = [
        between(random, -0.3, 0.9) * k,
        between(random, -0.35, 0.25) * k,
        between(random, -0.3, 0.3) * k,
    ];
    for p in pixels.chunks_exact_mut(3) {
        let green = ((p[1] - 0.5 * (p[0] + p[2])) * 8.0 + 0.1).clamp(0.0, 1.0);
        for c in 0..3 {
            p[c] *= 1.0 + gain[c] * green;
        }
    }
}

fn change_saturation(pixels: &mut [f32], factor: f32) {
    for p in pixels.chunks_exact_mut(3) {
        let grey = 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2];
        for v in p {
            *v = grey + (*v - grey) * factor;
        }
    }
}

/// Gain and white balance, gamma, haze (towards a bluish white) and contrast, by a lookup table for each channel.
fn change_tone(pixels: &mut [f32], k: f32, haze: f32, random: &mut impl Rng) {
    const STEPS: usize = 1024;
    let brightness = between(random, 1.0 - 0.5 * k, 1.0 + 0.5 * k);
    let offset = between(random, -0.15, 0.15) * k;
    let gamma = between(random, 1.0 - 0.4 * k, 1.0 + 0.6 * k);
    let contrast = between(random, 1.0 - 0.4 * k, 1.0 + 0.5 * k);
    let tables: [Vec<f32>; 3] = std::array::from_fn(|c| {
        let balance = between(random, 1.0 - 0.3 * k, 1.0 + 0.3 * k);
        (0..STEPS)
            .map(|i| {
                let v = i as f32 / (STEPS - 1) as f32;
                let v = (v * brightness * balance + offset)
                    .clamp(0.0, 1.0)
                    .powf(gamma);
                let v = (v - 0.5) * contrast + 0.5;
                v * (1.0 - haze) + haze * [0.8, 0.85, 0.92][c]
            })
            .collect()
    });
    for p in pixels.chunks_exact_mut(3) {
        for c in 0..3 {
            p[c] = tables[c][(p[c].clamp(0.0, 1.0) * (STEPS - 1) as f32 + 0.5) as usize];
        }
    }
}

/// Histogram equalisation of the brightness, blended with the original by `share`.
fn equalise(pixels: &mut [f32], share: f32) {
    let bin =
        |p: &[f32]| ((0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2]).clamp(0.0, 1.0) * 255.0) as usize;
    let mut below = [0u32; 256];
    for p in pixels.chunks_exact(3) {
        below[bin(p)] += 1;
    }
    let mut sum = 0;
    let total = (pixels.len() / 3).max(1) as f32;
    let table: Vec<f32> = below
        .iter()
        .map(|count| {
            sum += count;
            sum as f32 / total
        })
        .collect();
    for p in pixels.chunks_exact_mut(3) {
        let grey = 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2];
        let shift = (table[bin(p)] - grey) * share;
        for v in p {
            *v += shift;
        }
    }
}

/// Local contrast normalisation: shifts mean and standard deviation of the brightness within `reach` pixels of each pixel
/// towards common values.
fn equalise_locally(pixels: &mut [f32], width: usize, height: usize, reach: usize, share: f32) {
    let (mean_wanted, deviation_wanted, most_gain) = (0.46, 0.19, 2.6);
    let grey: Vec<f32> = pixels
        .chunks_exact(3)
        .map(|p| 0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2])
        .collect();
    // Summed-area tables of the brightness and its square (Crow 1984).
    let stride = width + 1;
    let mut sums = vec![[0.0f64; 2]; stride * (height + 1)];
    for y in 0..height {
        let mut row = [0.0f64; 2];
        for x in 0..width {
            let v = f64::from(grey[y * width + x]);
            row = [row[0] + v, row[1] + v * v];
            let above = sums[y * stride + x + 1];
            sums[(y + 1) * stride + x + 1] = [above[0] + row[0], above[1] + row[1]];
        }
    }
    for y in 0..height {
        let (top, bottom) = (y.saturating_sub(reach), (y + reach + 1).min(height));
        for x in 0..width {
            let (left, right) = (x.saturating_sub(reach), (x + reach + 1).min(width));
            let count = ((bottom - top) * (right - left)) as f64;
            let at = |row: usize, column: usize, k: usize| sums[row * stride + column][k];
            let [mean, square] = [0, 1].map(|k| {
                (at(bottom, right, k) - at(top, right, k) - at(bottom, left, k) + at(top, left, k))
                    / count
            });
            let deviation = (square - mean * mean).max(0.0).sqrt() as f32;
            let value = grey[y * width + x];
            let gain = (deviation_wanted / deviation.max(0.02)).min(most_gain);
            let shift = (mean_wanted + (value - mean as f32) * gain - value) * share;
            for v in &mut pixels[(y * width + x) * 3..(y * width + x) * 3 + 3] {
                *v += shift;
            }
        }
    }
}

/// A shadow: darkens a quadrangle with a soft edge, less in blue.
fn cast_shadow(pixels: &mut [f32], width: usize, height: usize, random: &mut impl Rng) {
    let size = between(random, 0.1, 0.6) * width as f32;
    let centre = [
        between(random, 0.0, width as f32),
        between(random, 0.0, height as f32),
    ];
    let (sin, cos) = between(random, 0.0, std::f32::consts::PI).sin_cos();
    let half = [size, size * between(random, 0.15, 0.8)];
    let soft = between(random, 0.5, 4.0);
    let dark = between(random, 0.35, 0.8);
    let factor = [dark, dark * 1.02, dark * 1.08];
    for y in 0..height {
        for x in 0..width {
            let (dx, dy) = (x as f32 - centre[0], y as f32 - centre[1]);
            let outside =
                ((cos * dx + sin * dy).abs() - half[0]).max((cos * dy - sin * dx).abs() - half[1]);
            let share = (0.5 - outside / soft).clamp(0.0, 1.0);
            if share > 0.0 {
                let p = &mut pixels[(y * width + x) * 3..(y * width + x) * 3 + 3];
                for c in 0..3 {
                    p[c] *= 1.0 + (factor[c] - 1.0) * share;
                }
            }
        }
    }
}

/// Approximately Gaussian noise: the sum of eight uniform bytes.
fn add_noise(pixels: &mut [f32], sigma: f32, random: &mut impl Rng) {
    if sigma < 0.002 {
        return;
    }
    let mut state: u64 = random.random();
    // Eight bytes of 0..255: mean 1020, deviation 209.
    let scale = sigma / 209.0;
    for v in pixels {
        // SplitMix64 (Steele, Lea and Flood 2014).
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        let sum: u32 = z.to_le_bytes().into_iter().map(u32::from).sum();
        *v += (sum as f32 - 1020.0) * scale;
    }
}

/// Compresses as JPEG and decompresses; unchanged if the codec fails.
fn compressed(image: RgbImage, quality: u8) -> RgbImage {
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality);
    if image.write_with_encoder(encoder).is_err() {
        return image;
    }
    match image::load_from_memory_with_format(&bytes, image::ImageFormat::Jpeg) {
        Ok(decoded) => decoded.into_rgb8(),
        Err(_) => image,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn a_seed_decides_the_look_and_every_change_keeps_the_size() {
        let image = RgbImage::from_fn(64, 48, |x, y| {
            image::Rgb([(x * 4) as u8, (y * 5) as u8, 90])
        });
        let look = Look {
            equalised: 1.0,
            locally_equalised: 1.0,
            shadows: 1.0,
            haze: 1.0,
            season: 1.0,
            jpeg: 1.0,
            ..Look::default()
        };
        for seed in 0..8 {
            let mut a = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let mut b = a.clone();
            let change = |random| change_look(&image, None, Domain::Sat, &look, random);
            let one = change(&mut a);
            assert_eq!(one, change(&mut b));
            assert_eq!(one.dimensions(), (64, 48));
            assert_ne!(one, image);
        }
    }
}
