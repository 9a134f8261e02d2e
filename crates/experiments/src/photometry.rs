//! Changes of light and sharpness of photos (the paper's table 7, and the sweeps).

use image::RgbImage;
use image::imageops::blur;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A change of a photo's pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Photometry {
    /// None.
    #[default]
    Original,
    /// Every tone times this, clipped at white.
    Brightness(f64),
    /// Every tone's distance from the picture's mean times this.
    Contrast(f64),
    /// Gaussian blur of this many pixels of the photo (1 sigma).
    Blur(f64),
    /// Gaussian noise of this many tones (1 sigma), the same for equal pictures.
    Noise(f64),
}

impl Photometry {
    /// The changed picture.
    pub fn apply(self, picture: &RgbImage) -> RgbImage {
        let each = |change: &mut dyn FnMut(f64) -> f64| {
            let mut changed = picture.clone();
            for value in changed.iter_mut() {
                *value = change(f64::from(*value)).round().clamp(0.0, 255.0) as u8;
            }
            changed
        };
        match self {
            Self::Original => picture.clone(),
            Self::Brightness(factor) => each(&mut |v| v * factor),
            Self::Contrast(factor) => {
                let count = picture.as_raw().len().max(1) as f64;
                let mean = picture.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
                each(&mut |v| mean + (v - mean) * factor)
            }
            Self::Blur(sigma_px) if sigma_px <= 0.0 => picture.clone(),
            Self::Blur(sigma_px) => blur(picture, sigma_px as f32),
            Self::Noise(sigma) => {
                let mut rng = ChaCha8Rng::seed_from_u64(NOISE_SEED);
                each(&mut |v| v + sigma * normal(&mut rng))
            }
        }
    }
}

/// Seed of the noise.
const NOISE_SEED: u64 = 7;

/// A normal deviate (Box & Muller 1958).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    fn picture() -> RgbImage {
        RgbImage::from_fn(64, 64, |x, _| Rgb([if x < 32 { 100 } else { 200 }; 3]))
    }

    #[test]
    fn tones_change_as_said() {
        let tones = |change: Photometry| {
            let changed = change.apply(&picture());
            [changed.get_pixel(8, 8).0[0], changed.get_pixel(56, 8).0[0]]
        };
        assert_eq!(tones(Photometry::Original), [100, 200]);
        assert_eq!(tones(Photometry::Brightness(0.5)), [50, 100]);
        assert_eq!(tones(Photometry::Brightness(1.5)), [150, 255]);
        assert_eq!(tones(Photometry::Contrast(0.6)), [120, 180]);
    }

    #[test]
    fn blur_smears_an_edge_and_noise_has_its_deviation() {
        let soft = Photometry::Blur(2.0).apply(&picture());
        let edge = soft.get_pixel(32, 30).0[0];
        assert!((130..180).contains(&edge), "{edge}");
        let noisy = Photometry::Noise(10.0).apply(&picture());
        let original = picture();
        let variance: f64 = noisy
            .iter()
            .zip(original.iter())
            .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
            .sum::<f64>()
            / noisy.as_raw().len() as f64;
        assert!((variance.sqrt() - 10.0).abs() < 0.5, "{}", variance.sqrt());
        assert_eq!(noisy, Photometry::Noise(10.0).apply(&picture()));
    }
}
