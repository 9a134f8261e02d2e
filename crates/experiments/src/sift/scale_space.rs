//! The scale space: octaves of ever more blurred pictures, and their differences (Lowe 2004, section 3).

use super::SiftOptions;
use super::plane::Plane;

/// Blur that a picture is taken to have already, pixels (Lowe 2004, section 3.3).
const CAMERA_SIGMA_PX: f32 = 0.5;

/// Sides below this many pixels show nothing that could be found.
const LEAST_SIDE_PX: usize = 12;

/// Pictures of one resolution.
#[derive(Debug)]
pub struct Octave {
    /// `intervals + 3` pictures; picture `i` is blurred by `sigma * 2^(i / intervals)` of this octave's pixels.
    pub gaussians: Vec<Plane>,
    /// Differences of neighbours: `intervals + 2`.
    pub differences: Vec<Plane>,
    /// Pixels of the original picture a pixel of this octave: 0.5 for the first, then 1, 2, ...
    pub px: f32,
}

/// All octaves of a picture, the finest first; the first has twice the picture's resolution.
pub fn octaves(picture: &Plane, options: &SiftOptions) -> Vec<Octave> {
    let doubled = picture.doubled();
    let least = doubled.width().min(doubled.height());
    if least < LEAST_SIDE_PX {
        return Vec::new();
    }
    // Down to about four pixels, counted as OpenCV does.
    let count = ((least as f32).log2() - 2.0).round() as usize + 1;
    let missing = (options.sigma_px.powi(2) - (2.0 * CAMERA_SIGMA_PX).powi(2))
        .max(0.01)
        .sqrt();
    let mut base = doubled.blurred(missing);
    let mut all = Vec::with_capacity(count);
    let mut px = 0.5;
    while all.len() < count && base.width().min(base.height()) >= LEAST_SIDE_PX {
        let octave = octave(base, px, options);
        base = octave.gaussians[options.intervals].halved();
        all.push(octave);
        px *= 2.0;
    }
    all
}

fn octave(base: Plane, px: f32, options: &SiftOptions) -> Octave {
    let sigma = |i: usize| options.sigma_px * 2f32.powf(i as f32 / options.intervals as f32);
    let mut gaussians = vec![base];
    for i in 1..options.intervals + 3 {
        let added = (sigma(i).powi(2) - sigma(i - 1).powi(2)).sqrt();
        let next = gaussians[i - 1].blurred(added);
        gaussians.push(next);
    }
    let differences = gaussians
        .windows(2)
        .map(|pair| pair[1].minus(&pair[0]))
        .collect();
    Octave {
        gaussians,
        differences,
        px,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::GrayImage;

    #[test]
    fn octaves_halve_until_too_small() {
        let picture = Plane::of(&GrayImage::new(64, 48));
        let all = octaves(&picture, &SiftOptions::default());
        let sizes: Vec<(usize, f32)> = all.iter().map(|o| (o.gaussians[0].width(), o.px)).collect();
        assert_eq!(sizes, [(128, 0.5), (64, 1.0), (32, 2.0), (16, 4.0)]);
        assert!(
            all.iter()
                .all(|o| o.gaussians.len() == 6 && o.differences.len() == 5)
        );
        assert!(octaves(&Plane::of(&GrayImage::new(3, 3)), &SiftOptions::default()).is_empty());
    }
}
