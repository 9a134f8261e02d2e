//! Resampling through a homography: for each output pixel the point of the source, and a filter there.

use image::{GrayImage, RgbImage};
use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::padded_image::PaddedImage;

/// Resolution of the reduced photo relative to the query.
///
/// Measured on a drone photo against the exact mean over each turned query pixel: bilinear interpolation of a level 1.5
/// times as fine has a third to a half less error than of a level as fine (or of one 1.25 times as fine), and keeps
/// 95 to 99 % of the contrast of fine detail; twice as fine it sharpens and aliases.
pub const LEVEL_PX_PER_QUERY_PX: f64 = 1.5;

/// Interpolation between pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Interpolation {
    /// Bilinear, 2 x 2 pixels; for levels finer than the query.
    Bilinear,
    /// Bicubic, 4 x 4 pixels: the cubic convolution of Keys 1981 with a = -1/2; for photos that are no finer than the
    /// query, which bilinear interpolation would blur.
    Bicubic,
}

impl Interpolation {
    /// The interpolation for a level with this many pixels per query pixel.
    pub(crate) fn suited_to(level_px_per_query_px: f64) -> Self {
        if level_px_per_query_px < 1.4 {
            Self::Bicubic
        } else {
            Self::Bilinear
        }
    }
}

/// Fills `image` and `mask` from `level`. `level_from_out` maps continuous pixels; its homogeneous coordinate is the
/// depth along the optical axis, 1 at the output's centre. Output pixels that no level pixel covers, or deeper than
/// `most_depth`, stay as they are.
pub(crate) fn warp(
    level: &PaddedImage,
    level_from_out: &Matrix3<f64>,
    interpolation: Interpolation,
    most_depth: f64,
    image: &mut RgbImage,
    mask: &mut GrayImage,
) {
    let width = image.width() as usize;
    if width == 0 || level.width == 0 || level.height == 0 {
        return;
    }
    let m = level_from_out;
    let affine = m[(2, 0)] == 0.0 && m[(2, 1)] == 0.0;
    let rows = image
        .par_chunks_exact_mut(3 * width)
        .zip(mask.par_chunks_exact_mut(width))
        .enumerate();
    let (level_width, level_height) = (level.width as f64, level.height as f64);
    let rows = rows.with_min_len(16);
    // Pixels of four bytes, as in the level: with three, compilers do not keep a pixel in one vector.
    rows.for_each_init(
        || vec![[0; 4]; width],
        |line, (y, (rgb, seen))| {
            line.fill([0; 4]);
            let y = y as f64 + 0.5;
            let start = [
                m[(0, 1)] * y + m[(0, 2)],
                m[(1, 1)] * y + m[(1, 2)],
                m[(2, 1)] * y + m[(2, 2)],
            ];
            for (x, (out, seen)) in line.iter_mut().zip(seen.iter_mut()).enumerate() {
                let x = x as f64 + 0.5;
                let mut u = m[(0, 0)] * x + start[0];
                let mut v = m[(1, 0)] * x + start[1];
                if !affine {
                    let w = m[(2, 0)] * x + start[2];
                    if !(w > 0.0 && w <= most_depth) {
                        continue;
                    }
                    u /= w;
                    v /= w;
                }
                if !(u >= 0.0 && u <= level_width && v >= 0.0 && v <= level_height) {
                    continue;
                }
                *seen = 255;
                *out = match interpolation {
                    Interpolation::Bilinear => bilinear(level, u, v),
                    Interpolation::Bicubic => bicubic(level, u, v),
                };
            }
            let (pixels, _) = rgb.as_chunks_mut::<3>();
            for ((out, &[r, g, b, _]), &seen) in pixels.iter_mut().zip(line.iter()).zip(seen.iter())
            {
                if seen == 255 {
                    *out = [r, g, b];
                }
            }
        },
    );
}

/// Splits a continuous coordinate into the index (from the border's corner) of the pixel whose centre is at or before
/// it, and the way to the next centre.
#[inline(always)]
fn split(coordinate: f64) -> (usize, f32) {
    // At least 0 - 0.5 + 3: truncation is the floor.
    let shifted = coordinate + (PaddedImage::BORDER as f64 - 0.5);
    let index = shifted as i32;
    (index as usize, (shifted - f64::from(index)) as f32)
}

#[inline(always)]
fn bilinear(level: &PaddedImage, u: f64, v: f64) -> [u8; 4] {
    let (x, right) = split(u);
    let (y, down) = split(v);
    let weights_x = [1.0 - right, right];
    let weights_y = [1.0 - down, down];
    sum::<2>(level, x, y, weights_x, weights_y)
}

#[inline(always)]
fn bicubic(level: &PaddedImage, u: f64, v: f64) -> [u8; 4] {
    let (x, right) = split(u);
    let (y, down) = split(v);
    sum::<4>(level, x - 1, y - 1, keys_weights(right), keys_weights(down))
}

/// Weights of the pixels at -1, 0, 1, 2 for a point `t` between 0 and 1 (Keys 1981, equation 15, a = -1/2).
#[inline(always)]
fn keys_weights(t: f32) -> [f32; 4] {
    let t2 = t * t;
    let t3 = t2 * t;
    [
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    ]
}

#[inline(always)]
fn sum<const N: usize>(
    level: &PaddedImage,
    x: usize,
    y: usize,
    weights_x: [f32; N],
    weights_y: [f32; N],
) -> [u8; 4] {
    let mut total = [0.5f32; 4];
    for (row, weight_y) in weights_y.into_iter().enumerate() {
        let taps = level.taps::<N>(x, y + row);
        let mut line = [0.0f32; 4];
        for (tap, weight_x) in taps.iter().zip(weights_x) {
            for (sum, &sample) in line.iter_mut().zip(tap) {
                *sum += weight_x * f32::from(sample);
            }
        }
        for (sum, line) in total.iter_mut().zip(line) {
            *sum += weight_y * line;
        }
    }
    // `as` saturates at 0 and 255.
    total.map(|sample| sample as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::area::Crop;

    /// The picture of `tests/golden/make_golden.py`.
    fn smooth(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            let (x, y) = (f64::from(x), f64::from(y));
            let sample = |v: f64| (127.5 + 120.0 * v).floor() as u8;
            image::Rgb([
                sample((x / 9.0).sin() * (y / 13.0).cos()),
                sample((x / 17.0 + y / 11.0).sin()),
                sample((x / 23.0 - y / 7.0).cos()),
            ])
        })
    }

    fn warped(
        picture: &RgbImage,
        matrix: &Matrix3<f64>,
        interpolation: Interpolation,
        (width, height): (u32, u32),
        most_depth: f64,
    ) -> (RgbImage, GrayImage) {
        let level = PaddedImage::new(picture, Crop::whole(picture.dimensions()));
        let mut image = RgbImage::new(width, height);
        let mut mask = GrayImage::new(width, height);
        warp(
            &level,
            matrix,
            interpolation,
            most_depth,
            &mut image,
            &mut mask,
        );
        (image, mask)
    }

    #[derive(serde::Deserialize)]
    struct Case {
        name: String,
        matrix: Vec<f64>,
        size: (u32, u32),
        samples: Vec<[u32; 5]>,
    }

    #[test]
    fn bilinear_agrees_with_opencv() {
        let cases: Vec<Case> =
            serde_json::from_str(include_str!("../tests/golden/warp.json")).unwrap();
        assert_eq!(cases.len(), 4);
        let picture = smooth(160, 120);
        for case in cases {
            let matrix = Matrix3::from_row_slice(&case.matrix);
            let (image, mask) = warped(
                &picture,
                &matrix,
                Interpolation::Bilinear,
                case.size,
                f64::INFINITY,
            );
            let mut worst = 0;
            let mut sum = 0;
            for &[x, y, r, g, b] in &case.samples {
                assert_eq!(mask.get_pixel(x, y).0, [255]);
                for (got, want) in image.get_pixel(x, y).0.into_iter().zip([r, g, b]) {
                    let apart = u32::from(got).abs_diff(want);
                    worst = worst.max(apart);
                    sum += apart;
                }
            }
            // OpenCV rounds coordinates to 1/32 px, worth up to 17 / 32 / 2 levels here, and rounds the result.
            let mean = f64::from(sum) / (3 * case.samples.len()) as f64;
            assert!(
                worst <= 2 && mean < 0.35,
                "{}: worst {worst}, mean {mean}",
                case.name
            );
        }
    }

    #[test]
    fn bicubic_follows_a_smooth_picture() {
        let picture = smooth(160, 120);
        let (sin, cos) = 27.0f64.to_radians().sin_cos();
        let matrix = Matrix3::new(cos, sin, 20.0, -sin, cos, 40.0, 0.0, 0.0, 1.0);
        let (image, mask) = warped(
            &picture,
            &matrix,
            Interpolation::Bicubic,
            (96, 96),
            f64::INFINITY,
        );
        let mut seen = 0;
        for (x, y, pixel) in image.enumerate_pixels() {
            if mask.get_pixel(x, y).0 != [255] {
                continue;
            }
            let at = matrix * nalgebra::Vector3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0);
            let (u, v) = (at.x - 0.5, at.y - 0.5);
            if !(2.0..157.0).contains(&u) || !(2.0..117.0).contains(&v) {
                continue;
            }
            seen += 1;
            let want = 127.0 + 120.0 * (u / 17.0 + v / 11.0).sin();
            assert!(
                (f64::from(pixel.0[1]) - want).abs() < 1.6,
                "{x},{y}: {} {want}",
                pixel.0[1]
            );
        }
        assert!(seen > 5000);
    }

    #[test]
    fn the_same_pixels_come_out_where_nothing_moves() {
        let picture = smooth(64, 32);
        for interpolation in [Interpolation::Bilinear, Interpolation::Bicubic] {
            let (image, mask) =
                warped(&picture, &Matrix3::identity(), interpolation, (64, 32), 1.0);
            assert_eq!(image, picture);
            assert!(mask.pixels().all(|seen| seen.0 == [255]));
        }
    }

    #[test]
    fn outside_and_too_deep_stay_black_and_masked() {
        let picture = RgbImage::from_pixel(64, 64, image::Rgb([200; 3]));
        // Depth 1 at the middle row, growing upwards.
        let matrix = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.05, 1.0 + 0.05 * 32.0);
        let (image, mask) = warped(&picture, &matrix, Interpolation::Bilinear, (64, 64), 2.0);
        for (x, y, seen) in mask.enumerate_pixels() {
            let depth = 1.0 - 0.05 * (f64::from(y) + 0.5 - 32.0);
            let (u, v) = ((f64::from(x) + 0.5) / depth, (f64::from(y) + 0.5) / depth);
            let expected = depth > 0.0 && depth <= 2.0 && u <= 64.0 && v <= 64.0;
            assert_eq!(seen.0[0] == 255, expected, "{x},{y}");
            assert_eq!(image.get_pixel(x, y).0[0] == 200, expected, "{x},{y}");
        }
    }

    #[test]
    fn threads_do_not_change_the_answer() {
        let picture = smooth(160, 120);
        let matrix = Matrix3::new(0.9, 0.3, 2.0, -0.3, 0.9, 30.0, 1e-4, 2e-4, 1.0);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                warped(
                    &picture,
                    &matrix,
                    Interpolation::Bicubic,
                    (160, 160),
                    f64::INFINITY,
                )
            })
        };
        assert_eq!(with(1), with(3));
    }
}
