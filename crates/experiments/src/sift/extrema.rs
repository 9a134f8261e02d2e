//! Keypoint candidates: extrema of the differences over place and scale, to a fraction of a pixel (Lowe 2004, sections 3.1 and 4).

use nalgebra::{Matrix3, Vector3};

use super::SiftOptions;
use super::plane::Plane;
use super::scale_space::Octave;

/// No extremum is looked for nearer to the border, pixels of the octave.
const BORDER_PX: usize = 5;

/// Times that the sample point may move to a neighbour while the extremum is interpolated.
const MAX_MOVES: usize = 5;

/// Tones run to this.
const WHITE: f32 = 255.0;

/// An extremum that passed the tests of contrast and shape; pixels of its octave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extremum {
    /// Column, interpolated.
    pub x_px: f32,
    /// Row, interpolated.
    pub y_px: f32,
    /// Index of the nearest difference picture in the octave.
    pub layer: usize,
    /// Interpolated blur, pixels of the octave.
    pub sigma_px: f32,
    /// Interpolated absolute difference, as a share of white.
    pub contrast: f32,
}

/// All extrema of an octave, layer by layer, row by row.
pub fn extrema(octave: &Octave, options: &SiftOptions) -> Vec<Extremum> {
    // Half of the contrast asked for, in whole tones: interpolation can only add to it.
    let least = (0.5 * options.contrast / options.intervals as f32 * WHITE).floor();
    let mut found = Vec::new();
    for layer in 1..=options.intervals {
        let planes = [layer - 1, layer, layer + 1].map(|i| &octave.differences[i]);
        let (width, height) = (planes[1].width(), planes[1].height());
        for y in BORDER_PX..height.saturating_sub(BORDER_PX) {
            for x in BORDER_PX..width.saturating_sub(BORDER_PX) {
                if planes[1].at(x, y).abs() > least && is_extremum(planes, x, y) {
                    found.extend(interpolate(octave, [x, y, layer], options));
                }
            }
        }
    }
    found
}

/// Whether none of the 26 neighbours is farther from zero on the same side.
fn is_extremum(planes: [&Plane; 3], x: usize, y: usize) -> bool {
    let value = planes[1].at(x, y);
    let sign = value.signum();
    planes.iter().all(|plane| {
        (y - 1..=y + 1).all(|row| {
            plane.row(row)[x - 1..=x + 1]
                .iter()
                .all(|&v| v * sign <= value * sign)
        })
    })
}

/// Value, gradient and Hessian over x, y and layer, as shares of white.
struct Quadric {
    value: f32,
    gradient: Vector3<f32>,
    hessian: Matrix3<f32>,
}

impl Quadric {
    fn at(octave: &Octave, [x, y, layer]: [usize; 3]) -> Self {
        let d = |dx: i32, dy: i32, dl: i32| {
            let plane = &octave.differences[layer.wrapping_add_signed(dl as isize)];
            plane.at(
                x.wrapping_add_signed(dx as isize),
                y.wrapping_add_signed(dy as isize),
            ) / WHITE
        };
        let value = d(0, 0, 0);
        let first = |step: [i32; 3]| {
            let [a, b, c] = step;
            (d(a, b, c) - d(-a, -b, -c)) / 2.0
        };
        let second = |step: [i32; 3]| {
            let [a, b, c] = step;
            d(a, b, c) + d(-a, -b, -c) - 2.0 * value
        };
        let cross = |u: [i32; 3], v: [i32; 3]| {
            let both = |s: i32| {
                d(u[0] + s * v[0], u[1] + s * v[1], u[2] + s * v[2])
                    + d(-u[0] - s * v[0], -u[1] - s * v[1], -u[2] - s * v[2])
            };
            (both(1) - both(-1)) / 4.0
        };
        const AXES: [[i32; 3]; 3] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
        Self {
            value,
            gradient: Vector3::from(AXES.map(first)),
            hessian: Matrix3::from_fn(|i, j| {
                if i == j {
                    second(AXES[i])
                } else {
                    cross(AXES[i], AXES[j])
                }
            }),
        }
    }
}

/// Moves to the extremum of the quadric through the sample and its neighbours; none where it runs away, has too little contrast or
/// lies along an edge.
fn interpolate(octave: &Octave, start: [usize; 3], options: &SiftOptions) -> Option<Extremum> {
    let mut at = start;
    for _ in 0..MAX_MOVES {
        let quadric = Quadric::at(octave, at);
        let offset = -quadric.hessian.lu().solve(&quadric.gradient)?;
        if offset.amax() < 0.5 {
            return accept(&quadric, offset, at, options);
        }
        at = moved(octave, at, offset, options)?;
    }
    None
}

fn moved(
    octave: &Octave,
    at: [usize; 3],
    offset: Vector3<f32>,
    options: &SiftOptions,
) -> Option<[usize; 3]> {
    let plane = &octave.differences[0];
    let low = [BORDER_PX, BORDER_PX, 1];
    let high = [
        plane.width() - BORDER_PX - 1,
        plane.height() - BORDER_PX - 1,
        options.intervals,
    ];
    let mut to = at;
    for axis in 0..3 {
        let step = offset[axis].round();
        // A step so long is a quadric so flat that it means nothing.
        if !step.is_finite() || step.abs() > 1e6 {
            return None;
        }
        let next = at[axis] as i64 + step as i64;
        if next < low[axis] as i64 || next > high[axis] as i64 {
            return None;
        }
        to[axis] = next as usize;
    }
    Some(to)
}

fn accept(
    quadric: &Quadric,
    offset: Vector3<f32>,
    at: [usize; 3],
    options: &SiftOptions,
) -> Option<Extremum> {
    let intervals = options.intervals as f32;
    let contrast = (quadric.value + 0.5 * quadric.gradient.dot(&offset)).abs();
    if contrast * intervals < options.contrast {
        return None;
    }
    let h = &quadric.hessian;
    let trace = h[(0, 0)] + h[(1, 1)];
    let determinant = h[(0, 0)] * h[(1, 1)] - h[(0, 1)] * h[(0, 1)];
    let edge = options.edge_ratio;
    if determinant <= 0.0 || trace * trace * edge >= (edge + 1.0).powi(2) * determinant {
        return None;
    }
    let [x, y, layer] = at;
    Some(Extremum {
        x_px: x as f32 + offset.x,
        y_px: y as f32 + offset.y,
        layer,
        sigma_px: options.sigma_px * 2f32.powf((layer as f32 + offset.z) / intervals),
        contrast,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sift::scale_space::octaves;
    use image::{GrayImage, Luma};

    /// A Gaussian blob between pixels.
    fn blob(x: f32, y: f32, sigma: f32) -> GrayImage {
        GrayImage::from_fn(64, 64, |i, j| {
            let d2 = (i as f32 - x).powi(2) + (j as f32 - y).powi(2);
            Luma([(40.0 + 180.0 * (-d2 / (2.0 * sigma * sigma)).exp()).round() as u8])
        })
    }

    #[test]
    fn a_blob_is_found_at_its_place_and_scale() {
        let options = SiftOptions::default();
        let picture = Plane::of(&blob(30.3, 33.6, 4.0));
        let found: Vec<(f32, f32, f32)> = octaves(&picture, &options)
            .iter()
            .flat_map(|octave| {
                extrema(octave, &options)
                    .into_iter()
                    .map(|e| {
                        (
                            e.x_px * octave.px,
                            e.y_px * octave.px,
                            e.sigma_px * octave.px,
                        )
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
        let strongest = found
            .iter()
            .find(|(x, y, _)| (x - 30.3).abs() < 0.2 && (y - 33.6).abs() < 0.2);
        let Some((_, _, sigma)) = strongest else {
            panic!("{found:?}");
        };
        // The difference of Gaussians of blur s and 1.26 s answers most to a blob of about 1.12 s.
        assert!((2.8..4.5).contains(sigma), "{sigma}");
    }

    #[test]
    fn an_edge_and_flat_ground_have_none() {
        let options = SiftOptions::default();
        let edge = GrayImage::from_fn(64, 64, |x, _| Luma([if x < 32 { 40 } else { 200 }]));
        for picture in [edge, GrayImage::from_pixel(64, 64, Luma([90]))] {
            let count: usize = octaves(&Plane::of(&picture), &options)
                .iter()
                .map(|o| extrema(o, &options).len())
                .sum();
            assert_eq!(count, 0);
        }
    }
}
