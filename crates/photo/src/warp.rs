//! Resampling through a homography: for each output pixel the point of the source, and a filter there.

use image::{GrayImage, RgbImage};
use nalgebra::Matrix3;
use rayon::prelude::*;

use crate::level::Level;

/// How pixels between pixels are made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// Two by two pixels, of a level finer than the query, which averages four to nine of its pixels in all.
    Bilinear,
    /// Four by four pixels of a level as fine as the query, the cubic convolution of Keys 1981 with a = -1/2.
    #[default]
    Bicubic,
}

impl Interpolation {
    /// How fine the level should be.
    pub(crate) fn level_px_per_query_px(self) -> f64 {
        match self {
            Self::Bilinear => 1.5,
            Self::Bicubic => 1.0,
        }
    }
}

/// Fills `image` and `mask` from `level`. `level_from_out` maps continuous pixels; its homogeneous coordinate is the
/// depth along the optical axis, 1 at the output's centre. Output pixels that no level pixel covers, or deeper than
/// `most_depth`, stay as they are.
pub(crate) fn warp(
    level: &Level,
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
    rows.with_min_len(16).for_each(|(y, (rgb, seen))| {
        let y = y as f64 + 0.5;
        let start = [
            m[(0, 1)] * y + m[(0, 2)],
            m[(1, 1)] * y + m[(1, 2)],
            m[(2, 1)] * y + m[(2, 2)],
        ];
        let (pixels, _) = rgb.as_chunks_mut::<3>();
        for (x, (out, seen)) in pixels.iter_mut().zip(seen.iter_mut()).enumerate() {
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
    });
}

/// Splits a continuous coordinate into the index (from the border's corner) of the pixel whose centre is at or before
/// it, and the way to the next centre.
#[inline(always)]
fn split(coordinate: f64) -> (usize, f32) {
    // At least 0 - 0.5 + 3: truncation is the floor.
    let shifted = coordinate + (Level::BORDER as f64 - 0.5);
    let index = shifted as i32;
    (index as usize, (shifted - f64::from(index)) as f32)
}

#[inline(always)]
fn bilinear(level: &Level, u: f64, v: f64) -> [u8; 3] {
    let (x, right) = split(u);
    let (y, down) = split(v);
    let weights_x = [1.0 - right, right];
    let weights_y = [1.0 - down, down];
    sum::<2>(level, x, y, weights_x, weights_y)
}

#[inline(always)]
fn bicubic(level: &Level, u: f64, v: f64) -> [u8; 3] {
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
    level: &Level,
    x: usize,
    y: usize,
    weights_x: [f32; N],
    weights_y: [f32; N],
) -> [u8; 3] {
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
    [total[0] as u8, total[1] as u8, total[2] as u8]
}
