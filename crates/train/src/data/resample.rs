//! Cutting a view out of a picture by a homography.

use super::picture::Picture;
use image::RgbImage;
use nalgebra::{Matrix3, Vector3};

/// The pyramid level whose pixels are nearest in size to those of a square view, measured at the central pixel of the view. It
/// may be beyond the last level of a small picture.
pub fn pyramid_level(picture_from_view: &Matrix3<f64>, side_px: f64) -> usize {
    let c = side_px / 2.0;
    let at = |x: f64, y: f64| {
        let p = picture_from_view * Vector3::new(x, y, 1.0);
        (p.x / p.z, p.y / p.z)
    };
    let (o, u, v) = (at(c, c), at(c + 1.0, c), at(c, c + 1.0));
    let scale = ((u.0 - o.0) * (v.1 - o.1) - (u.1 - o.1) * (v.0 - o.0))
        .abs()
        .sqrt();
    scale.max(1.0).log2().round() as usize
}

/// Resamples a square view by bilinear interpolation from the pyramid level whose pixels are nearest in size to its own.
///
/// `picture_from_view` maps pixels of the view to pixels of the picture (pixel centres at integers). Returns the view, black
/// outside the picture, and for each pixel whether it is inside.
pub fn warp(
    picture: &Picture,
    picture_from_view: &Matrix3<f64>,
    side_px: u32,
) -> (RgbImage, Vec<bool>) {
    let wanted = pyramid_level(picture_from_view, f64::from(side_px));
    let (image, level) = picture.level(wanted);
    let shrink = 1.0 / f64::from(1u32 << level);
    // Pixel centres: level pixel = (picture pixel + 0.5) * shrink - 0.5.
    let to_level = Matrix3::new(
        shrink,
        0.0,
        0.5 * shrink - 0.5,
        0.0,
        shrink,
        0.5 * shrink - 0.5,
        0.0,
        0.0,
        1.0,
    );
    let m = (to_level * picture_from_view).map(|v| v as f32);
    let (width, height) = (image.width() as usize, image.height() as usize);
    let raw = image.as_raw();
    let side = side_px as usize;
    let mut out = vec![0u8; side * side * 3];
    let mut seen = vec![false; side * side];
    for y in 0..side {
        for x in 0..side {
            let (fx, fy) = (x as f32, y as f32);
            let w = 1.0 / (m[(2, 0)] * fx + m[(2, 1)] * fy + m[(2, 2)]);
            let px = (m[(0, 0)] * fx + m[(0, 1)] * fy + m[(0, 2)]) * w;
            let py = (m[(1, 0)] * fx + m[(1, 1)] * fy + m[(1, 2)]) * w;
            if !(px >= -0.5 && py >= -0.5 && px <= width as f32 - 0.5 && py <= height as f32 - 0.5)
            {
                continue;
            }
            let (px, py) = (
                px.clamp(0.0, (width - 1) as f32),
                py.clamp(0.0, (height - 1) as f32),
            );
            let (ix, iy) = ((px as usize).min(width - 2), (py as usize).min(height - 2));
            let (ax, ay) = (px - ix as f32, py - iy as f32);
            let at = (iy * width + ix) * 3;
            let below = at + width * 3;
            let to = y * side + x;
            for c in 0..3 {
                let top = f32::from(raw[at + c]) * (1.0 - ax) + f32::from(raw[at + 3 + c]) * ax;
                let bottom =
                    f32::from(raw[below + c]) * (1.0 - ax) + f32::from(raw[below + 3 + c]) * ax;
                out[to * 3 + c] = (top + (bottom - top) * ay + 0.5) as u8;
            }
            seen[to] = true;
        }
    }
    (
        RgbImage::from_raw(side_px, side_px, out).unwrap_or_default(),
        seen,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identity_copies_and_outside_is_unseen() {
        let image = RgbImage::from_fn(40, 40, |x, y| image::Rgb([x as u8 * 5, y as u8 * 5, 7]));
        let picture = Picture::new(image.clone());
        let (same, seen) = warp(&picture, &Matrix3::identity(), 40);
        assert_eq!(same, image);
        assert!(seen.iter().all(|s| *s));
        let shift = Matrix3::new(1.0, 0.0, -10.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        let (moved, seen) = warp(&picture, &shift, 40);
        assert_eq!(moved.get_pixel(15, 3), image.get_pixel(5, 3));
        assert!(!seen[3] && seen[15]);
    }
}
