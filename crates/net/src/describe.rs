//! Local descriptors at keypoints (paper, eq. 15).

use grimnet_kernels::{Isa, PlainKernel, Tensor};
use rayon::prelude::*;

use crate::Keypoint;
use crate::spec::KEYPOINT_CELL_PX;

/// Keypoints that one task describes.
const BATCH: usize = 64;

/// Samples `field` (one vector for each 8 x 8 px cell) bilinearly at the keypoints and scales each vector to unit length.
/// The vector of a cell is at the cell's centre, as in PyTorch's `grid_sample(align_corners=False)`; beyond the outermost
/// centres the nearest one is used (PyTorch's zero padding gives the same direction).
pub(crate) fn describe(isa: Isa, field: &Tensor, keypoints: &[Keypoint]) -> Vec<f32> {
    let dim = field.channels();
    let mut out = vec![0.0; keypoints.len() * dim];
    let batches = out
        .par_chunks_mut(BATCH * dim)
        .zip(keypoints.par_chunks(BATCH));
    batches.for_each(|(rows, keypoints)| {
        isa.vectorise(Batch {
            field,
            keypoints,
            rows,
        })
    });
    out
}

struct Batch<'a> {
    field: &'a Tensor,
    keypoints: &'a [Keypoint],
    rows: &'a mut [f32],
}

impl PlainKernel for Batch<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            field,
            keypoints,
            rows,
        } = self;
        for (row, keypoint) in rows.chunks_exact_mut(field.channels()).zip(keypoints) {
            let (x0, x1, fx) = neighbours(keypoint.x_px, field.width());
            let (y0, y1, fy) = neighbours(keypoint.y_px, field.height());
            let [a, b, c, d] =
                [(y0, x0), (y0, x1), (y1, x0), (y1, x1)].map(|(y, x)| field.pixel(y, x));
            let (wa, wb, wc, wd) = (
                (1.0 - fy) * (1.0 - fx),
                (1.0 - fy) * fx,
                fy * (1.0 - fx),
                fy * fx,
            );
            for ((((v, a), b), c), d) in row.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *v = a * wa + b * wb + c * wc + d * wd;
            }
            normalise(row);
        }
    }
}

/// The two cells around a pixel, and the weight of the second.
#[inline(always)]
fn neighbours(at_px: f32, cells: usize) -> (usize, usize, f32) {
    let last = cells.saturating_sub(1);
    let at = ((at_px + 0.5) / KEYPOINT_CELL_PX as f32 - 0.5).clamp(0.0, last as f32);
    let first = at as usize;
    (first, (first + 1).min(last), at - first as f32)
}

/// Length below which a vector counts as zero (PyTorch's `normalize`).
const SMALLEST_NORM: f32 = 1e-12;

/// Scales a vector to unit length; a vector of zeros is not changed.
#[inline(always)]
pub fn normalise(row: &mut [f32]) {
    let factor = inverse_norm(row);
    row.iter_mut().for_each(|v| *v *= factor);
}

/// The reciprocal of the length.
#[inline(always)]
pub(crate) fn inverse_norm(row: &[f32]) -> f32 {
    1.0 / dot(row, row).sqrt().max(SMALLEST_NORM)
}

/// Partial sums: at least two vectors of every instruction set.
const LANES: usize = 32;

/// Scalar product, in partial sums that the compiler keeps in vector registers.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a_chunks, a_rest) = a.as_chunks::<LANES>();
    let (b_chunks, b_rest) = b.as_chunks::<LANES>();
    let mut sums = [0.0f32; LANES];
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    let (low, high) = sums.split_at(LANES / 2);
    low.iter().zip(high).map(|(a, b)| a + b).sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_px: f32, y_px: f32) -> Keypoint {
        Keypoint {
            x_px,
            y_px,
            score: 1.0,
        }
    }

    #[test]
    fn vectors_are_interpolated_between_cell_centres() {
        let field = Tensor::from_hwc(&[1.0, 0.0, 0.0, 1.0], 1, 2, 2);
        let rows = describe(
            Isa::detect(),
            &field,
            &[
                at(3.5, 3.0),
                at(7.5, 0.0),
                at(0.0, 7.0),
                at(15.0, 7.0),
                at(5.5, 1.0),
            ],
        );
        let half = 0.5f32.sqrt();
        let norm = (0.75f32 * 0.75 + 0.25 * 0.25).sqrt();
        let expected = [
            1.0,
            0.0,
            half,
            half,
            1.0,
            0.0,
            0.0,
            1.0,
            0.75 / norm,
            0.25 / norm,
        ];
        for (value, expected) in rows.iter().zip(expected) {
            assert!((value - expected).abs() < 1e-6, "{rows:?}");
        }
    }

    #[test]
    fn zero_stays_zero_and_dot_is_a_scalar_product() {
        assert_eq!(
            describe(Isa::detect(), &Tensor::new(1, 1, 3), &[at(0.0, 0.0)]),
            [0.0; 3]
        );
        let a: Vec<f32> = (0..51).map(|v| v as f32).collect();
        assert_eq!(dot(&a, &a), 42925.0);
    }
}
