//! Ground that gives no fix: a photo of open water, and a photo under snow.

use image::{Rgb, RgbImage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// What covers the ground on a leg of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cover {
    /// Open water with waves that move.
    Water,
    /// Fresh snow, through which only the strongest edges show.
    Snow,
}

/// A leg of a flight over one cover.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CoveredLeg {
    /// What covers the ground.
    pub cover: Cover,
    /// Its begin, seconds.
    pub from_s: f64,
    /// Its end, seconds.
    pub to_s: f64,
}

/// Waves that are summed.
const WAVES: usize = 10;
/// Metres per square second.
const GRAVITY_M_S2: f64 = 9.81;
/// What is left of the contrast under snow.
const SNOW_CONTRAST: f32 = 0.05;

/// Where a photo of water is taken from, straight down.
#[derive(Debug, Clone, Copy)]
pub struct WaterView {
    /// Metres east and north of any fixed point.
    pub place_en_m: [f64; 2],
    /// Bearing of the photo's top, degrees clockwise from north.
    pub heading_deg: f64,
    /// Ground metres per pixel.
    pub gsd_m: f64,
}

/// A photo of open water at a time: waves of deep water (speed by their length), glitter, and the sensor's noise.
#[must_use]
pub fn water(size_px: (u32, u32), view: &WaterView, time_s: f64, seed: u64) -> RgbImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // Wave number east and north, phase now.
    let waves: [[f32; 3]; WAVES] = std::array::from_fn(|_| {
        let length_m = 1.2 * 10f64.powf(rng.random::<f64>());
        let towards: f64 = rng.random_range(-0.9..0.9);
        let number = std::f64::consts::TAU / length_m;
        let phase: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let now = phase - (GRAVITY_M_S2 * number).sqrt() * time_s;
        [
            (number * towards.sin()) as f32,
            (number * towards.cos()) as f32,
            now.rem_euclid(std::f64::consts::TAU) as f32,
        ]
    });
    let mut noise = ChaCha8Rng::seed_from_u64(seed ^ time_s.to_bits());
    let (sin, cos) = view.heading_deg.to_radians().sin_cos();
    RgbImage::from_fn(size_px.0, size_px.1, |x, y| {
        let right_m = (f64::from(x) - f64::from(size_px.0) / 2.0) * view.gsd_m;
        let up_m = (f64::from(size_px.1) / 2.0 - f64::from(y)) * view.gsd_m;
        let east_m = (view.place_en_m[0] + right_m * cos + up_m * sin) as f32;
        let north_m = (view.place_en_m[1] - right_m * sin + up_m * cos) as f32;
        let slope: f32 = waves
            .iter()
            .map(|[east, north, phase]| (east * east_m + north * north_m + phase).sin())
            .sum();
        let glitter = if slope > 6.5 { 60.0 } else { 0.0 };
        let light = 1.6 * slope + glitter + noise.random_range(-3.0f32..3.0);
        Rgb([34.0, 62.0, 78.0].map(|base: f32| (base + light).clamp(0.0, 255.0) as u8))
    })
}

/// The same ground under snow.
#[must_use]
pub fn under_snow(photo: &RgbImage, seed: u64) -> RgbImage {
    let mut noise = ChaCha8Rng::seed_from_u64(seed);
    let mut covered = photo.clone();
    for pixel in covered.pixels_mut() {
        let [r, g, b] = pixel.0.map(f32::from);
        let grey = (r + 2.0 * g + b) / 4.0;
        let light = SNOW_CONTRAST * (grey - 120.0) + noise.random_range(-2.5f32..2.5);
        pixel.0 = [226.0, 230.0, 236.0].map(|base: f32| (base + light).clamp(0.0, 255.0) as u8);
    }
    covered
}

/// Legs over water and snow in turns: each lasts 10 to `longest_s` seconds (by the logarithm), the first begins after half a
/// minute over town, and about `apart_s` lie between them.
#[must_use]
pub fn covered_legs(duration_s: f64, longest_s: f64, apart_s: f64, seed: u64) -> Vec<CoveredLeg> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut legs = Vec::new();
    let mut from_s = 30.0 + rng.random_range(0.0..0.5) * apart_s;
    while from_s < duration_s {
        let length_s = 10.0 * (longest_s / 10.0).max(1.0).powf(rng.random::<f64>());
        let cover = if legs.len() % 2 == 0 {
            Cover::Water
        } else {
            Cover::Snow
        };
        legs.push(CoveredLeg {
            cover,
            from_s,
            to_s: from_s + length_s,
        });
        from_s += length_s + apart_s * rng.random_range(0.7..1.3);
    }
    legs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_move_and_snow_hides() {
        let view = WaterView {
            place_en_m: [10.0, 20.0],
            heading_deg: 30.0,
            gsd_m: 0.2,
        };
        let now = water((64, 48), &view, 1.0, 3);
        assert_eq!(now, water((64, 48), &view, 1.0, 3));
        assert_ne!(now, water((64, 48), &view, 1.5, 3));
        let striped = RgbImage::from_fn(64, 48, |x, _| Rgb([if x % 8 < 4 { 20 } else { 220 }; 3]));
        let snow = under_snow(&striped, 1);
        let contrast = |picture: &RgbImage| {
            let grey = |x| {
                let column = (0..48).map(|y| f64::from(picture.get_pixel(x, y)[0]));
                column.sum::<f64>() / 48.0
            };
            (grey(6) - grey(2)).abs()
        };
        assert!(contrast(&snow) < 0.08 * contrast(&striped));
        assert!(snow.pixels().all(|pixel| pixel[1] > 200));
    }

    #[test]
    fn legs_have_the_asked_lengths_and_do_not_overlap() {
        let legs = covered_legs(3600.0, 120.0, 90.0, 5);
        assert!(legs.len() > 15);
        for pair in legs.windows(2) {
            assert!(pair[0].to_s < pair[1].from_s);
            assert_ne!(pair[0].cover, pair[1].cover);
        }
        let lengths: Vec<f64> = legs.iter().map(|leg| leg.to_s - leg.from_s).collect();
        assert!(lengths.iter().all(|length| (10.0..=120.0).contains(length)));
        assert!(lengths.iter().any(|length| *length > 60.0));
    }
}
