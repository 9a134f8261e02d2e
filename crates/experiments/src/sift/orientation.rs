//! Orientations of a keypoint: peaks of the histogram of gradients around it (Lowe 2004, section 5).

use super::extrema::Extremum;
use super::plane::Plane;

/// Bins of the histogram: 10 degrees each.
const BINS: usize = 36;

/// Deviation of the window's weights, in units of the keypoint's blur.
const WINDOW_SIGMAS: f32 = 1.5;

/// Reach of the window, in deviations of its weights.
const WINDOW_REACH: f32 = 3.0;

/// Peaks of at least this share of the highest are orientations of their own.
const PEAK_SHARE: f32 = 0.8;

/// Weights with which the histogram is smoothed: binomial over five bins.
const SMOOTHING: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];

/// The directions of a keypoint, degrees counter-clockwise from the picture's right, in `[0, 360)`.
pub fn orientations_deg(gaussian: &Plane, at: &Extremum) -> Vec<f32> {
    let histogram = smoothed(&gradient_histogram(gaussian, at));
    let highest = histogram.iter().copied().fold(0.0, f32::max);
    let mut found = Vec::new();
    for (i, &here) in histogram.iter().enumerate() {
        let (left, right) = (histogram[(i + BINS - 1) % BINS], histogram[(i + 1) % BINS]);
        if here > left && here > right && here >= PEAK_SHARE * highest {
            // Vertex of the parabola through three bins.
            let bin = i as f32 + 0.5 * (left - right) / (left - 2.0 * here + right);
            found.push((bin * 360.0 / BINS as f32).rem_euclid(360.0));
        }
    }
    found
}

fn gradient_histogram(gaussian: &Plane, at: &Extremum) -> [f32; BINS] {
    let sigma = WINDOW_SIGMAS * at.sigma_px;
    let reach = (WINDOW_REACH * sigma).round() as i64;
    let (x0, y0) = (at.x_px.round() as i64, at.y_px.round() as i64);
    let mut histogram = [0.0; BINS];
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let Some((right, up)) = gaussian.gradient(x0 + dx, y0 + dy) else {
                continue;
            };
            let weight = (-((dx * dx + dy * dy) as f32) / (2.0 * sigma * sigma)).exp();
            let turn = up.atan2(right).to_degrees().rem_euclid(360.0) / 360.0;
            let bin = (turn * BINS as f32).round() as usize % BINS;
            histogram[bin] += weight * right.hypot(up);
        }
    }
    histogram
}

fn smoothed(histogram: &[f32; BINS]) -> [f32; BINS] {
    std::array::from_fn(|i| {
        let neighbours = SMOOTHING.iter().enumerate();
        neighbours
            .map(|(k, weight)| weight * histogram[(i + BINS + k - 2) % BINS])
            .sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, Luma};

    #[test]
    fn a_ramp_points_up_its_slope() {
        let at = Extremum {
            x_px: 20.0,
            y_px: 20.0,
            layer: 1,
            sigma_px: 2.0,
            contrast: 0.1,
        };
        // Rises to the right by 2 and downwards by 2 a pixel: 45 degrees below the right.
        let ramp = GrayImage::from_fn(41, 41, |x, y| Luma([(2 * x + 2 * y) as u8]));
        let found = orientations_deg(&Plane::of(&ramp), &at);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0] - 315.0).abs() < 6.0, "{found:?}");
        assert!(orientations_deg(&Plane::of(&GrayImage::new(41, 41)), &at).is_empty());
    }
}
