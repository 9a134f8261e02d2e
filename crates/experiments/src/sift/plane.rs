//! One channel of floating-point pixels, with what a scale space needs: blur, doubling, halving.

use image::GrayImage;

/// Half a Gaussian kernel reaches this many deviations.
const KERNEL_REACH_SIGMAS: f32 = 4.0;

/// A grey picture of `f32`, row by row; tones are 0 to 255 as in the picture that it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    /// Tones of a grey picture.
    pub fn of(picture: &GrayImage) -> Self {
        Self {
            width: picture.width() as usize,
            height: picture.height() as usize,
            values: picture.as_raw().iter().map(|&v| f32::from(v)).collect(),
        }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The value at a column and row inside the plane.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// One row.
    pub fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.width..(y + 1) * self.width]
    }

    /// Differences over two pixels to the right and upwards; none at the border.
    #[inline]
    pub fn gradient(&self, x: i64, y: i64) -> Option<(f32, f32)> {
        let inside = x > 0 && y > 0 && x < self.width as i64 - 1 && y < self.height as i64 - 1;
        inside.then(|| {
            let (x, y) = (x as usize, y as usize);
            (
                self.at(x + 1, y) - self.at(x - 1, y),
                self.at(x, y - 1) - self.at(x, y + 1),
            )
        })
    }

    /// `self - other`, pixel by pixel, of planes of one size.
    pub fn minus(&self, other: &Self) -> Self {
        Self {
            values: self
                .values
                .iter()
                .zip(&other.values)
                .map(|(a, b)| a - b)
                .collect(),
            ..*self
        }
        .sized_as(self)
    }

    fn sized_as(self, other: &Self) -> Self {
        debug_assert_eq!((self.width, self.height), (other.width, other.height));
        self
    }

    /// Twice as large, by linear interpolation: pixel `2i` is pixel `i`, so that positions halve exactly (Lowe 2004, section 3.3).
    pub fn doubled(&self) -> Self {
        let (width, height) = (2 * self.width, 2 * self.height);
        let mut values = vec![0.0; width * height];
        for (y, out) in values.chunks_exact_mut(width.max(1)).enumerate() {
            let upper = self.row(y / 2);
            let lower = self.row((y / 2 + y % 2).min(self.height - 1));
            let value = |x: usize| (upper[x] + lower[x]) / 2.0;
            for (x, pair) in out.chunks_exact_mut(2).enumerate() {
                let here = value(x);
                pair[0] = here;
                pair[1] = (here + value((x + 1).min(self.width - 1))) / 2.0;
            }
        }
        Self {
            width,
            height,
            values,
        }
    }

    /// Every second pixel of every second row.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let values = (0..height)
            .flat_map(|y| self.row(2 * y).iter().step_by(2).take(width).copied())
            .collect();
        Self {
            width,
            height,
            values,
        }
    }

    /// Convolved with a Gaussian; beyond the border the picture is mirrored about its outermost pixels.
    pub fn blurred(&self, sigma: f32) -> Self {
        let kernel = gaussian_kernel(sigma);
        let reach = kernel.len() / 2;
        let mut rows = vec![0.0f32; self.values.len()];
        let mut padded = vec![0.0f32; self.width + 2 * reach];
        for (y, out) in rows.chunks_exact_mut(self.width.max(1)).enumerate() {
            let row = self.row(y);
            for (i, value) in padded.iter_mut().enumerate() {
                *value = row[mirrored(i as i64 - reach as i64, self.width)];
            }
            for (weight, shifted) in kernel.iter().zip(padded.windows(self.width)) {
                add_scaled(out, shifted, *weight);
            }
        }
        let mut values = vec![0.0f32; rows.len()];
        for (y, out) in values.chunks_exact_mut(self.width.max(1)).enumerate() {
            for (i, weight) in kernel.iter().enumerate() {
                let from = mirrored(y as i64 + i as i64 - reach as i64, self.height);
                add_scaled(
                    out,
                    &rows[from * self.width..(from + 1) * self.width],
                    *weight,
                );
            }
        }
        Self { values, ..*self }.sized_as(self)
    }
}

fn add_scaled(out: &mut [f32], values: &[f32], weight: f32) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += weight * value;
    }
}

/// Normalised weights of an odd number of pixels.
fn gaussian_kernel(sigma: f32) -> Vec<f32> {
    let reach = (sigma * KERNEL_REACH_SIGMAS).round().max(1.0) as i32;
    let weights: Vec<f32> = (-reach..=reach)
        .map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp())
        .collect();
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|w| w / sum).collect()
}

/// Index in `0..count` of an index that may lie outside: ... 2 1 0 1 2 ...
fn mirrored(index: i64, count: usize) -> usize {
    let last = count as i64 - 1;
    if last <= 0 {
        return 0;
    }
    let folded = index.rem_euclid(2 * last);
    folded.min(2 * last - folded) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, values: &[f32]) -> Plane {
        Plane {
            width,
            height: values.len() / width,
            values: values.to_vec(),
        }
    }

    #[test]
    fn doubling_interpolates_and_halving_takes_it_back() {
        let small = plane(2, &[0.0, 4.0, 8.0, 12.0]);
        let large = small.doubled();
        assert_eq!(large.row(0), [0.0, 2.0, 4.0, 4.0]);
        assert_eq!(large.row(1), [4.0, 6.0, 8.0, 8.0]);
        assert_eq!(large.row(3), [8.0, 10.0, 12.0, 12.0]);
        assert_eq!(large.halved(), small);
    }

    #[test]
    fn blur_keeps_flat_ground_and_spreads_a_point_by_its_variance() {
        let flat = plane(9, &[7.0; 81]).blurred(1.6);
        assert!(flat.values.iter().all(|v| (v - 7.0).abs() < 1e-4));
        let mut values = vec![0.0; 31 * 31];
        values[15 * 31 + 15] = 1.0;
        let spread = plane(31, &values).blurred(1.5);
        let variance: f32 = (0..31)
            .flat_map(|y| (0..31).map(move |x| (x, y)))
            .map(|(x, y)| spread.at(x, y) * (x as f32 - 15.0).powi(2))
            .sum();
        assert!((variance - 2.25).abs() < 0.01, "{variance}");
    }

    #[test]
    fn indices_fold_at_both_ends() {
        let folded: Vec<usize> = (-3..7).map(|i| mirrored(i, 4)).collect();
        assert_eq!(folded, [3, 2, 1, 0, 1, 2, 3, 2, 1, 0]);
        assert_eq!(mirrored(-9, 1), 0);
    }
}
