//! From keypoint classes to a probability for each pixel.

use grimnet_kernels::Tensor;
use rayon::prelude::*;

use crate::spec::CELL_PX;

const CELL: usize = CELL_PX as usize;
const PIXELS: usize = CELL * CELL;

/// Softmax over the 65 classes of each cell, without the class "none", shuffled into pixels: `heatmap` is resized to
/// (8 h) x (8 w), row by row.
pub(crate) fn heatmap_from_logits(logits: &Tensor, heatmap: &mut Vec<f32>) {
    let width = logits.width() * CELL;
    heatmap.resize(logits.height() * CELL * width, 0.0);
    heatmap
        .par_chunks_exact_mut(CELL * width)
        .enumerate()
        .for_each(|(cell_y, rows)| {
            for cell_x in 0..logits.width() {
                let mut classes = [0.0f32; PIXELS + 1];
                classes.copy_from_slice(logits.pixel(cell_y, cell_x));
                softmax(&mut classes);
                let (pixels, _) = classes.as_chunks::<CELL>();
                for (row, pixels) in rows.chunks_exact_mut(width).zip(pixels) {
                    row[cell_x * CELL..][..CELL].copy_from_slice(pixels);
                }
            }
        });
}

/// In place: exp(v) over the sum of all.
pub(crate) fn softmax(values: &mut [f32]) {
    let largest = values.iter().copied().fold(f32::MIN, f32::max);
    let (chunks, rest) = values.as_chunks_mut::<8>();
    let mut sums = [0.0f32; 8];
    for chunk in chunks.iter_mut() {
        for (v, sum) in chunk.iter_mut().zip(&mut sums) {
            *v = exp(*v - largest);
            *sum += *v;
        }
    }
    let mut sum: f32 = sums.iter().sum();
    for v in rest {
        *v = exp(*v - largest);
        sum += *v;
    }
    let factor = 1.0 / sum;
    values.iter_mut().for_each(|v| *v *= factor);
}

/// e^x for x in -87..=88 (below, e^-87), relative error below 2e-7. Cody-Waite reduction and the minimax polynomial of Cephes
/// `expf`; free of branches and calls, so that a compiler makes vectors of it.
fn exp(x: f32) -> f32 {
    // Adding 1.5 * 2^23 rounds to an integer and leaves it in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.max(-87.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * LN2_HIGH - n * LN2_LOW;
    let p = 1.987_569_1e-4;
    let p = p * r + 1.398_199_9e-3;
    let p = p * r + 8.333_452e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_5e-1;
    let p = p * r + 0.5;
    let p = p * r * r + r + 1.0;
    p * f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0f32.to_bits()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_exact_to_single_precision() {
        for i in -8700..=100 {
            let x = i as f32 / 100.0;
            let exact = f64::from(x).exp();
            assert!((f64::from(exp(x)) / exact - 1.0).abs() < 2e-7, "{x}");
        }
        assert!(exp(-1e30) > 0.0 && exp(f32::MIN) < 1e-37);
    }

    #[test]
    fn pixels_lie_where_their_class_says() {
        let mut logits = Tensor::new(2, 3, PIXELS + 1);
        for y in 0..2 {
            for x in 0..3 {
                logits.pixel_mut(y, x)[10 * y + x] = 3.0;
            }
        }
        let mut heatmap = Vec::new();
        heatmap_from_logits(&logits, &mut heatmap);
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
