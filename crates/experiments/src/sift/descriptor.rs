//! The descriptor of a keypoint: 4 x 4 histograms of 8 gradient directions, relative to its orientation (Lowe 2004, section 6).

use super::plane::Plane;

/// Histograms along a side.
const SIDE: usize = 4;

/// Directions of each.
const DIRECTIONS: usize = 8;

/// Numbers in a descriptor.
pub const DESCRIPTOR_DIM: usize = SIDE * SIDE * DIRECTIONS;

/// Side of a histogram's square, in units of the keypoint's blur.
const SQUARE_SIGMAS: f32 = 3.0;

/// No number may be larger than this share of the descriptor's length, against strong single gradients.
const LARGEST_SHARE: f32 = 0.2;

/// Where the descriptor is taken; pixels of the octave.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Column.
    pub x_px: f32,
    /// Row.
    pub y_px: f32,
    /// Blur of the keypoint.
    pub sigma_px: f32,
    /// Its orientation, degrees counter-clockwise from the picture's right.
    pub orientation_deg: f32,
}

/// Histograms with a margin of one on each side, so that sharing among neighbours needs no edge case; directions wrap.
struct Histograms([f32; (SIDE + 2) * (SIDE + 2) * DIRECTIONS]);

impl Histograms {
    /// Shares a weight among the two nearest rows, columns (from -1 to SIDE) and directions.
    fn add(&mut self, row: f32, column: f32, direction: f32, weight: f32) {
        let [r, c, d] = [row, column, direction].map(f32::floor);
        let [fr, fc, fd] = [row - r, column - c, direction - d];
        for (i, wr) in [1.0 - fr, fr].into_iter().enumerate() {
            for (j, wc) in [1.0 - fc, fc].into_iter().enumerate() {
                let cell = (r as i64 + 1) as usize + i;
                let cell = cell * (SIDE + 2) + (c as i64 + 1) as usize + j;
                for (k, wd) in [1.0 - fd, fd].into_iter().enumerate() {
                    let bin = (d as i64 + k as i64).rem_euclid(DIRECTIONS as i64) as usize;
                    self.0[cell * DIRECTIONS + bin] += weight * wr * wc * wd;
                }
            }
        }
    }

    fn inner(&self) -> [f32; DESCRIPTOR_DIM] {
        std::array::from_fn(|i| {
            let (cell, bin) = (i / DIRECTIONS, i % DIRECTIONS);
            let (row, column) = (cell / SIDE + 1, cell % SIDE + 1);
            self.0[(row * (SIDE + 2) + column) * DIRECTIONS + bin]
        })
    }
}

/// The descriptor, a unit vector; all zero where the picture is flat.
pub fn describe(gaussian: &Plane, at: &Place) -> [f32; DESCRIPTOR_DIM] {
    let square = SQUARE_SIGMAS * at.sigma_px;
    let half_diagonal = square * std::f32::consts::SQRT_2 * (SIDE as f32 + 1.0) * 0.5;
    let picture_diagonal = (gaussian.width() as f32).hypot(gaussian.height() as f32);
    let reach = half_diagonal.round().min(picture_diagonal) as i64;
    let (sin, cos) = (-at.orientation_deg).to_radians().sin_cos();
    let (x0, y0) = (at.x_px.round() as i64, at.y_px.round() as i64);
    let middle = SIDE as f32 / 2.0 - 0.5;
    let within = -1.0..SIDE as f32;
    let mut histograms = Histograms([0.0; (SIDE + 2) * (SIDE + 2) * DIRECTIONS]);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            // In the keypoint's own frame, in histogram squares.
            let column = (dx as f32 * cos + dy as f32 * sin) / square;
            let row = (-dx as f32 * sin + dy as f32 * cos) / square;
            let (in_columns, in_rows) = (column + middle, row + middle);
            if !(in_columns > within.start
                && within.contains(&in_columns)
                && in_rows > within.start
                && within.contains(&in_rows))
            {
                continue;
            }
            let Some((right, up)) = gaussian.gradient(x0 + dx, y0 + dy) else {
                continue;
            };
            let turn_deg = (up.atan2(right).to_degrees() - at.orientation_deg).rem_euclid(360.0);
            let window = (-(column * column + row * row) / (0.5 * (SIDE * SIDE) as f32)).exp();
            let direction = turn_deg * DIRECTIONS as f32 / 360.0;
            histograms.add(in_rows, in_columns, direction, window * right.hypot(up));
        }
    }
    normalised(histograms.inner())
}

fn normalised(mut values: [f32; DESCRIPTOR_DIM]) -> [f32; DESCRIPTOR_DIM] {
    let length = |values: &[f32; DESCRIPTOR_DIM]| values.iter().map(|v| v * v).sum::<f32>().sqrt();
    let most = LARGEST_SHARE * length(&values);
    for value in &mut values {
        *value = value.min(most);
    }
    let clipped = length(&values);
    if clipped > 0.0 {
        for value in &mut values {
            *value /= clipped;
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, Luma};

    fn textured(size: u32) -> GrayImage {
        GrayImage::from_fn(size, size, |x, y| {
            let (x, y) = (x as f32, y as f32);
            Luma([(128.0 + 50.0 * (x * 0.21).sin() + 40.0 * (y * 0.33 + x * 0.05).cos()) as u8])
        })
    }

    fn at(x_px: f32, y_px: f32, orientation_deg: f32) -> Place {
        Place {
            x_px,
            y_px,
            sigma_px: 2.0,
            orientation_deg,
        }
    }

    #[test]
    fn a_quarter_turn_of_picture_and_orientation_changes_nothing() {
        let picture = textured(61);
        let upright = describe(&Plane::of(&picture), &at(30.0, 30.0, 20.0));
        // Turned clockwise: what pointed at 20 degrees now points at -70.
        let turned = image::imageops::rotate90(&picture);
        let again = describe(&Plane::of(&turned), &at(30.0, 30.0, -70.0));
        let similarity: f32 = upright.iter().zip(&again).map(|(a, b)| a * b).sum();
        assert!(similarity > 0.999, "{similarity}");
        let length: f32 = upright.iter().map(|v| v * v).sum();
        assert!((length - 1.0).abs() < 1e-5);
    }

    #[test]
    fn flat_ground_has_no_descriptor() {
        let flat = Plane::of(&GrayImage::from_pixel(61, 61, Luma([77])));
        assert_eq!(describe(&flat, &at(30.0, 30.0, 0.0)), [0.0; DESCRIPTOR_DIM]);
    }
}
