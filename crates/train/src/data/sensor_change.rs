//! Differences between two sensors: how they see colours and textures, and the tones of another data set.
//!
//! All functions work on interleaved RGB in 0..1 and keep the picture's size, so that points stay where they are.

use rand::Rng;

use super::filters::gaussian;

/// Side of the largest random filter, pixels.
const FILTER_SIDES: [usize; 3] = [1, 3, 5];

/// Mixes the picture with its convolution by a random filter over space and colours, brought to the same mean and deviation: what is
/// bright for one sensor may be dark for another, and textures change, but outlines stay (random convolution; Xu et al. 2021).
pub(super) fn filter_randomly(
    pixels: &mut [f32],
    width: usize,
    height: usize,
    random: &mut impl Rng,
) {
    let side = FILTER_SIDES[random.random_range(0..FILTER_SIDES.len())];
    // The sum of three uniform numbers is close enough to a normal one.
    let mut weight = || (0..3).map(|_| random.random_range(-1.0..1.0)).sum::<f32>();
    let taps: Vec<[[f32; 3]; 3]> = (0..side * side)
        .map(|_| std::array::from_fn(|_| std::array::from_fn(|_| weight())))
        .collect();
    let share = random.random_range(0.2..0.8);
    let reach = side / 2;
    let mut filtered = vec![0.0f32; pixels.len()];
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0.0f32; 3];
            for (i, tap) in taps.iter().enumerate() {
                let row = (y + i / side).saturating_sub(reach).min(height - 1);
                let column = (x + i % side).saturating_sub(reach).min(width - 1);
                let p = &pixels[(row * width + column) * 3..][..3];
                for (out, [r, g, b]) in sum.iter_mut().zip(tap) {
                    *out += r * p[0] + g * p[1] + b * p[2];
                }
            }
            filtered[(y * width + x) * 3..][..3].copy_from_slice(&sum);
        }
    }
    for c in 0..3 {
        let [(mean, deviation), (filtered_mean, filtered_deviation)] =
            [&*pixels, &filtered].map(|of| moments(of, c));
        let gain = deviation / filtered_deviation.max(1e-4);
        for (p, f) in pixels.chunks_exact_mut(3).zip(filtered.chunks_exact(3)) {
            let matched = mean + (f[c] - filtered_mean) * gain;
            p[c] += (matched - p[c]) * share;
        }
    }
}

/// Replaces the picture's low frequencies by those of another picture, in part: the tones of another sensor, season and haze over the
/// same detail (after Yang and Soatto 2020, who exchange amplitudes of the lowest frequencies).
pub(super) fn mix_low_frequencies(
    pixels: &mut [f32],
    other: &[f32],
    width: usize,
    height: usize,
    random: &mut impl Rng,
) {
    let sigma_px = random.random_range(0.04..0.15) * width as f32;
    let share = random.random_range(0.3..0.9);
    let [own, others] = [&*pixels, other].map(|of| {
        let mut low = of.to_vec();
        gaussian(&mut low, width, height, sigma_px);
        low
    });
    for ((v, own), other) in pixels.iter_mut().zip(own).zip(others) {
        *v += (other - own) * share;
    }
}

/// Mean and standard deviation of a channel.
fn moments(pixels: &[f32], channel: usize) -> (f32, f32) {
    let count = (pixels.len() / 3).max(1) as f32;
    let values = || pixels.iter().skip(channel).step_by(3);
    let mean = values().sum::<f32>() / count;
    let variance = values().map(|v| (v - mean).powi(2)).sum::<f32>() / count;
    (mean, variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn picture() -> Vec<f32> {
        (0..48 * 40)
            .flat_map(|i| [(i % 48) as f32 / 48.0, (i / 48 % 7) as f32 / 7.0, 0.3])
            .collect()
    }

    #[test]
    fn a_random_filter_changes_the_picture_and_keeps_each_channels_mean() {
        let mut negative = 0;
        for seed in 0..40 {
            let mut pixels = picture();
            filter_randomly(&mut pixels, 48, 40, &mut ChaCha8Rng::seed_from_u64(seed));
            assert_ne!(pixels, picture());
            for c in 0..3 {
                let difference = moments(&pixels, c).0 - moments(&picture(), c).0;
                assert!(difference.abs() < 1e-4, "{difference}");
            }
            negative += usize::from(pixels[3 * 40] < pixels[3 * 8]);
        }
        assert!(
            (3..30).contains(&negative),
            "what was bright is dark in some: {negative}"
        );
    }

    #[test]
    fn low_frequencies_are_those_of_the_other_picture_and_detail_stays() {
        let checker: Vec<f32> = (0..64 * 64)
            .flat_map(|i| [0.2 + 0.1 * ((i % 64 + i / 64) % 2) as f32; 3])
            .collect();
        let bright = vec![0.8; 64 * 64 * 3];
        let mut pixels = checker.clone();
        let random = &mut ChaCha8Rng::seed_from_u64(2);
        mix_low_frequencies(&mut pixels, &bright, 64, 64, random);
        let centre = 3 * (32 * 64 + 32);
        assert!(pixels[centre] > checker[centre] + 0.1);
        let step = |p: &[f32]| p[centre + 3] - p[centre];
        assert!((step(&pixels) - step(&checker)).abs() < 0.02);
    }
}
