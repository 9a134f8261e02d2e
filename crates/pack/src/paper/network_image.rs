//! Resizing of the paper's tiles and photos to the network's resolution.

use image::RgbImage;
use image::imageops::{FilterType, resize};

/// Resizes a picture to the square that the network sees in paper mode, `side_px` x `side_px`, whatever its shape.
///
/// Bilinear interpolation (paper, section 3.1), antialiased where the picture is reduced, as Pillow's and torchvision's `BILINEAR`
/// do; the paper does not say which. Tiles of the map and photos go through this same function.
pub fn resize_for_network(picture: &RgbImage, side_px: u32) -> RgbImage {
    if picture.dimensions() == (side_px, side_px) {
        return picture.clone();
    }
    resize(picture, side_px, side_px, FilterType::Triangle)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_and_fine_stripes_become_grey() {
        let ramp = RgbImage::from_fn(100, 50, |x, y| Rgb([2 * x as u8, 4 * y as u8, 7]));
        let small = resize_for_network(&ramp, 40);
        for (x, y, pixel) in small.enumerate_pixels() {
            // Near the border the filter is cut off.
            if !(4..36).contains(&x) || !(4..36).contains(&y) {
                continue;
            }
            let expected = [
                2.0 * ((x as f32 + 0.5) * 2.5 - 0.5),
                4.0 * ((y as f32 + 0.5) * 1.25 - 0.5),
                7.0,
            ];
            for (found, expected) in pixel.0.iter().zip(expected) {
                assert!(
                    (f32::from(*found) - expected).abs() <= 1.0,
                    "{x} {y}: {pixel:?}"
                );
            }
        }
        let stripes = RgbImage::from_fn(512, 512, |x, _| Rgb([255 * (x % 2) as u8; 3]));
        for (x, _, pixel) in resize_for_network(&stripes, 128).enumerate_pixels() {
            if (1..127).contains(&x) {
                assert!(pixel[0].abs_diff(127) < 3, "{x}: {pixel:?}");
            }
        }
        assert_eq!(resize_for_network(&small, 40), small);
    }
}
