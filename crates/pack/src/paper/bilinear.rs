//! Bilinear resizing of the paper's tiles: four neighbours, no averaging (OpenCV `INTER_LINEAR`).

use image::{Rgb, RgbImage};

/// Resizes to `side` x `side` pixels.
///
/// Pixel centres correspond as `(x + 0.5) * width / side - 0.5`; beyond the border the border is repeated.
pub fn resize_bilinear(image: &RgbImage, side: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    let columns: Vec<_> = (0..side).map(|x| neighbours(x, side, width)).collect();
    let rows: Vec<_> = (0..side).map(|y| neighbours(y, side, height)).collect();
    RgbImage::from_fn(side, side, |x, y| {
        let ((x0, x1, fx), (y0, y1, fy)) = (columns[x as usize], rows[y as usize]);
        let corner = |x, y| image.get_pixel(x, y).0.map(f32::from);
        let (a, b, c, d) = (
            corner(x0, y0),
            corner(x1, y0),
            corner(x0, y1),
            corner(x1, y1),
        );
        Rgb(std::array::from_fn(|i| {
            let (top, bottom) = (a[i] + fx * (b[i] - a[i]), c[i] + fx * (d[i] - c[i]));
            (top + fy * (bottom - top)).round() as u8
        }))
    })
}

/// Two source pixels and the weight of the second.
fn neighbours(at: u32, out: u32, len: u32) -> (u32, u32, f32) {
    let last = len.saturating_sub(1);
    let place = ((at as f32 + 0.5) * len as f32 / out as f32 - 0.5).clamp(0.0, last as f32);
    let first = place.floor();
    (first as u32, (first as u32 + 1).min(last), place - first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp() {
        let ramp = RgbImage::from_fn(100, 50, |x, y| Rgb([2 * x as u8, y as u8, 7]));
        let small = resize_bilinear(&ramp, 40);
        for (x, y, pixel) in small.enumerate_pixels() {
            let expected = [
                2.0 * ((x as f32 + 0.5) * 2.5 - 0.5),
                (y as f32 + 0.5) * 1.25 - 0.5,
                7.0,
            ];
            for (found, expected) in pixel.0.iter().zip(expected) {
                assert!(
                    (f32::from(*found) - expected).abs() <= 0.5,
                    "{x} {y}: {pixel:?}"
                );
            }
        }
        assert_eq!(resize_bilinear(&small, 40), small);
    }
}
