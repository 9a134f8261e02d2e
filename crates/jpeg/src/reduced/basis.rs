//! The inverse cosine transform to fewer pixels than a block has, as a sum of pictures.
//!
//! Each output is the mean of the full transform's samples over its part of the block, as libjpeg's reduced transforms have it
//! (`jidctred.c`). A block has few coefficients, so their pictures are added one by one.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Samples of a block are kept in units of 1/16.
pub(crate) const SAMPLE_UNITS: f32 = 16.0;

/// Position in a block of each coefficient, row by row, in zigzag order (T.81, figure A.6).
const ZIGZAG: [usize; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20,
    13, 6, 7, 14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59,
    52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63,
];

/// The picture of each coefficient of a component: what it adds to the samples of a block, for a value of 1, in units of 1/16.
#[derive(Debug)]
pub(crate) struct Basis {
    /// Samples of a block, horizontally and vertically: 1, 2, 4 or 8.
    pub size: (usize, usize),
    /// 64 pictures in zigzag order, each row by row. That of the DC coefficient is not used.
    pictures: Vec<f32>,
}

impl Basis {
    /// For blocks of this size, with these steps of the coefficients in zigzag order.
    pub(crate) fn new(size: (usize, usize), steps: &[u16; 64]) -> Self {
        let (columns, rows) = (means_of_cosines(size.0), means_of_cosines(size.1));
        let mut pictures = Vec::with_capacity(64 * size.0 * size.1);
        for (&place, &step) in ZIGZAG.iter().zip(steps) {
            let (row, column) = (&rows[place / 8], &columns[place % 8]);
            for vertical in row {
                for horizontal in column {
                    let sample = vertical * horizontal * f64::from(step);
                    pictures.push(sample as f32 * SAMPLE_UNITS);
                }
            }
        }
        Self { size, pictures }
    }

    /// Samples of a block.
    pub(crate) fn samples(&self) -> usize {
        self.size.0 * self.size.1
    }

    /// The pictures, of `N` samples each; `None` if blocks have another number of them.
    #[inline(always)]
    pub(crate) fn pictures<const N: usize>(&self) -> Option<&[[f32; N]; 64]> {
        self.pictures.as_chunks::<N>().0.first_chunk()
    }
}

/// The one-dimensional inverse transform (T.81, A.3.3) of each frequency, averaged over `size` equal parts of the 8 samples.
fn means_of_cosines(size: usize) -> [Vec<f64>; 8] {
    let averaged = 8 / size;
    std::array::from_fn(|frequency| {
        let scale = if frequency == 0 { FRAC_1_SQRT_2 } else { 1.0 } / 2.0;
        let cosine = |x: usize| ((2 * x + 1) as f64 * frequency as f64 * PI / 16.0).cos();
        (0..size)
            .map(|part| {
                let sum: f64 = (part * averaged..(part + 1) * averaged).map(cosine).sum();
                scale * sum / averaged as f64
            })
            .collect()
    })
}
