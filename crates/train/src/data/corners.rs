//! Corner detection (Shi and Tomasi 1994), for keypoint labels.

use super::peaks::peaks;
use image::RgbImage;

/// Least strength of a corner as a share of the strongest.
const QUALITY: f32 = 0.01;
/// Margin in which the structure tensor is not defined.
const MARGIN_PX: usize = 3;

/// Corners of a picture, strongest first: local maxima, within `radius_px`, of the smaller eigenvalue of the structure
/// tensor over 5 x 5 pixels (binomial weights).
pub fn corners(image: &RgbImage, radius_px: usize, most: usize) -> Vec<[usize; 2]> {
    let (w, h) = (image.width() as usize, image.height() as usize);
    if w < 16 || h < 16 {
        return Vec::new();
    }
    let grey: Vec<f32> = image
        .as_raw()
        .chunks_exact(3)
        .map(|p| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]))
        .collect();
    let n = w * h;
    let (mut xx, mut yy, mut xy) = (vec![0.0f32; n], vec![0.0f32; n], vec![0.0f32; n]);
    for y in 1..h - 1 {
        let (up, mid, down) = (
            &grey[(y - 1) * w..y * w],
            &grey[y * w..(y + 1) * w],
            &grey[(y + 1) * w..(y + 2) * w],
        );
        let row = y * w;
        for x in 1..w - 1 {
            let gx =
                up[x + 1] - up[x - 1] + 2.0 * (mid[x + 1] - mid[x - 1]) + down[x + 1] - down[x - 1];
            let gy = down[x - 1] - up[x - 1] + 2.0 * (down[x] - up[x]) + down[x + 1] - up[x + 1];
            xx[row + x] = gx * gx;
            yy[row + x] = gy * gy;
            xy[row + x] = gx * gy;
        }
    }
    let mut scratch = vec![0.0f32; n];
    for plane in [&mut xx, &mut yy, &mut xy] {
        smooth(plane, &mut scratch, w, h);
    }
    let mut strength = scratch;
    let mut best = 0.0f32;
    for i in 0..n {
        let (a, b, c) = (xx[i], yy[i], xy[i]);
        let s = 0.5 * (a + b) - (0.25 * (a - b) * (a - b) + c * c).sqrt();
        strength[i] = s;
        best = best.max(s);
    }
    let mut found = peaks(&strength, w, radius_px, MARGIN_PX, best * QUALITY);
    found.truncate(most);
    found.into_iter().map(|(_, at)| at).collect()
}

/// Separable binomial filter 1-4-6-4-1; the border becomes 0.
fn smooth(plane: &mut [f32], scratch: &mut [f32], w: usize, h: usize) {
    scratch.fill(0.0);
    for y in 0..h {
        let row = &plane[y * w..(y + 1) * w];
        let out = &mut scratch[y * w..(y + 1) * w];
        for x in 2..w - 2 {
            out[x] = row[x - 2] + row[x + 2] + 4.0 * (row[x - 1] + row[x + 1]) + 6.0 * row[x];
        }
    }
    plane.fill(0.0);
    for y in 2..h - 2 {
        for x in 0..w {
            let i = y * w + x;
            plane[i] = scratch[i - 2 * w]
                + scratch[i + 2 * w]
                + 4.0 * (scratch[i - w] + scratch[i + w])
                + 6.0 * scratch[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_has_four_corners() {
        let image = RgbImage::from_fn(64, 64, |x, y| {
            image::Rgb(
                [if (20..44).contains(&x) && (16..40).contains(&y) {
                    200
                } else {
                    30
                }; 3],
            )
        });
        let found = corners(&image, 4, 10);
        assert_eq!(found.len(), 4, "{found:?}");
        for (cx, cy) in [(20.0, 16.0), (44.0, 16.0), (20.0, 40.0), (44.0, 40.0)] {
            assert!(
                found
                    .iter()
                    .any(|[x, y]| (*x as f64 - cx).hypot(*y as f64 - cy) < 3.0),
                "{found:?}"
            );
        }
    }
}
