//! The keypoint probability of each pixel, from the classes of its cell (paper, eq. 11-12).

use grimnet_kernels::{Isa, PlainKernel, Tensor};
use rayon::prelude::*;

use crate::softmax::softmax;
use crate::spec::KEYPOINT_CELL_PX;

const CELL: usize = KEYPOINT_CELL_PX as usize;
const PIXELS: usize = CELL * CELL;

/// Softmax over the 65 classes of each cell; all but the class "none" become the pixels of the cell. `heatmap` is resized to
/// (8 h) x (8 w), row by row.
pub(crate) fn heatmap_from_logits(isa: Isa, logits: &Tensor, heatmap: &mut Vec<f32>) {
    let width = logits.width() * CELL;
    heatmap.resize(logits.height() * CELL * width, 0.0);
    let rows = heatmap.par_chunks_exact_mut(CELL * width).enumerate();
    rows.for_each(|(y, rows)| {
        isa.vectorise(CellRow {
            logits: logits.row(y),
            pitch: logits.pixel_pitch(),
            rows,
            width,
        })
    });
}

/// A row of cells, and its eight rows of pixels.
struct CellRow<'a> {
    logits: &'a [f32],
    pitch: usize,
    rows: &'a mut [f32],
    width: usize,
}

impl PlainKernel for CellRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (cell_x, logits) in self.logits.chunks_exact(self.pitch).enumerate() {
            let mut classes = [0.0f32; PIXELS + 1];
            classes.copy_from_slice(&logits[..PIXELS + 1]);
            softmax(&mut classes);
            let (pixels, _) = classes.as_chunks::<CELL>();
            for (row, pixels) in self.rows.chunks_exact_mut(self.width).zip(pixels) {
                row[cell_x * CELL..][..CELL].copy_from_slice(pixels);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_lie_where_their_class_says() {
        let mut logits = Tensor::new(2, 3, PIXELS + 1);
        for y in 0..2 {
            for x in 0..3 {
                logits.pixel_mut(y, x)[10 * y + x] = 3.0;
            }
        }
        let mut heatmap = Vec::new();
        heatmap_from_logits(Isa::detect(), &logits, &mut heatmap);
        assert_eq!(heatmap.len(), 16 * 24);
        let (peak, other) = (3f32.exp() / (3f32.exp() + 64.0), 1.0 / (3f32.exp() + 64.0));
        for (i, &p) in heatmap.iter().enumerate() {
            let (py, px) = (i / 24, i % 24);
            let class = 10 * (py / 8) + px / 8;
            let expected = if (py % 8) * 8 + px % 8 == class {
                peak
            } else {
                other
            };
            assert!((p - expected).abs() < 1e-6, "{py} {px}");
        }
    }
}
