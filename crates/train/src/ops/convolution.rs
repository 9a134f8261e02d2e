//! 3x3 convolution (padding 1, stride 1 or 2) and both its gradients on NHWC batches, for the CPU.
//!
//! Weights are tap-major, `[3, 3, in, out]` flat. Stride 1 needs no window matrix: in a zero-padded NHWC picture the three
//! neighbours of a row of the window are contiguous, so the convolution is three products with overlapping rows
//! (one per row of the window); the two padding columns are computed too and dropped. Stride 2 gathers windows first.

use super::strided_product::{View, product};
use rayon::prelude::*;

/// Sizes of one convolution over a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// Pictures.
    pub batch: usize,
    /// Rows of the input; even where `stride` is 2.
    pub height: usize,
    /// Columns of the input; even where `stride` is 2.
    pub width: usize,
    /// Channels of the input.
    pub in_channels: usize,
    /// Channels of the output.
    pub out_channels: usize,
    /// 1 or 2.
    pub stride: usize,
}

impl Geometry {
    /// Rows of the output.
    pub fn out_height(&self) -> usize {
        self.height / self.stride
    }

    /// Columns of the output.
    pub fn out_width(&self) -> usize {
        self.width / self.stride
    }

    /// Elements of one input picture.
    pub fn input_len(&self) -> usize {
        self.height * self.width * self.in_channels
    }

    /// Elements of one output picture.
    pub fn output_len(&self) -> usize {
        self.out_height() * self.out_width() * self.out_channels
    }

    /// Elements of the weights.
    pub fn weight_len(&self) -> usize {
        9 * self.in_channels * self.out_channels
    }
}

/// A picture with a border of one zero pixel, and a tail so that overlapping rows may be read past its end.
fn padded(picture: &[f32], height: usize, width: usize, channels: usize, out: &mut Vec<f32>) {
    let row = (width + 2) * channels;
    out.clear();
    out.resize((height + 2) * row + 2 * channels, 0.0);
    for y in 0..height {
        let at = (y + 1) * row + channels;
        out[at..at + width * channels]
            .copy_from_slice(&picture[y * width * channels..(y + 1) * width * channels]);
    }
}

/// Stride-1 convolution of a padded picture; `wide` is scratch, `out` is `height x width x out_channels`.
fn convolve_padded(
    padded: &[f32],
    weight: &[f32],
    [height, width, inc, outc]: [usize; 4],
    wide: &mut Vec<f32>,
    out: &mut [f32],
) {
    let padded_width = width + 2;
    // Blocks of rows keep the three passes over the result inside the second-level cache.
    let block = (98_304 / (padded_width * outc)).clamp(1, height);
    wide.resize(block * padded_width * outc, 0.0);
    for first in (0..height).step_by(block) {
        let rows = block.min(height - first);
        for dy in 0..3 {
            product(
                [rows * padded_width, outc, 3 * inc],
                padded,
                View::rows((first + dy) * padded_width * inc, inc),
                weight,
                View::rows(dy * 3 * inc * outc, outc),
                wide,
                View::rows(0, outc),
                dy > 0,
            );
        }
        for y in 0..rows {
            let from = y * padded_width * outc;
            let to = (first + y) * width * outc;
            out[to..to + width * outc].copy_from_slice(&wide[from..from + width * outc]);
        }
    }
}

/// The windows of a stride-2 convolution as rows of 9 x channels.
fn windows(padded: &[f32], geometry: &Geometry, out: &mut Vec<f32>) {
    let (c, row) = (
        geometry.in_channels,
        (geometry.width + 2) * geometry.in_channels,
    );
    let (height, width) = (geometry.out_height(), geometry.out_width());
    out.resize(height * width * 9 * c, 0.0);
    for y in 0..height {
        for x in 0..width {
            let to = (y * width + x) * 9 * c;
            for dy in 0..3 {
                let from = (2 * y + dy) * row + 2 * x * c;
                out[to + dy * 3 * c..to + (dy + 1) * 3 * c]
                    .copy_from_slice(&padded[from..from + 3 * c]);
            }
        }
    }
}

/// Forward: `y[b, i, j, o] = sum x[b, s*i + dy - 1, s*j + dx - 1, c] * w[dy, dx, c, o]`.
pub fn forward(geometry: &Geometry, x: &[f32], weight: &[f32]) -> Vec<f32> {
    let g = *geometry;
    let mut y = vec![0.0; g.batch * g.output_len()];
    y.par_chunks_mut(g.output_len())
        .zip(x.par_chunks(g.input_len()))
        .for_each_init(
            || (Vec::new(), Vec::new()),
            |(border, scratch), (y, x)| {
                padded(x, g.height, g.width, g.in_channels, border);
                if g.stride == 1 {
                    convolve_padded(
                        border,
                        weight,
                        [g.height, g.width, g.in_channels, g.out_channels],
                        scratch,
                        y,
                    );
                } else {
                    windows(border, &g, scratch);
                    let k = 9 * g.in_channels;
                    product(
                        [g.out_height() * g.out_width(), g.out_channels, k],
                        scratch,
                        View::rows(0, k),
                        weight,
                        View::rows(0, g.out_channels),
                        y,
                        View::rows(0, g.out_channels),
                        false,
                    );
                }
            },
        );
    y
}

/// Gradient with respect to the input.
pub fn grad_input(geometry: &Geometry, grad_y: &[f32], weight: &[f32]) -> Vec<f32> {
    let g = *geometry;
    let (inc, outc) = (g.in_channels, g.out_channels);
    let mut grad_x = vec![0.0; g.batch * g.input_len()];
    if g.stride == 1 {
        // The gradient is the convolution of grad_y with the window turned by half a turn, channels swapped.
        let mut turned = vec![0.0; weight.len()];
        for tap in 0..9 {
            for c in 0..inc {
                for o in 0..outc {
                    turned[((8 - tap) * outc + o) * inc + c] = weight[(tap * inc + c) * outc + o];
                }
            }
        }
        grad_x
            .par_chunks_mut(g.input_len())
            .zip(grad_y.par_chunks(g.output_len()))
            .for_each_init(
                || (Vec::new(), Vec::new()),
                |(border, scratch), (grad_x, grad_y)| {
                    padded(grad_y, g.height, g.width, outc, border);
                    convolve_padded(
                        border,
                        &turned,
                        [g.height, g.width, outc, inc],
                        scratch,
                        grad_x,
                    );
                },
            );
        return grad_x;
    }
    grad_x
        .par_chunks_mut(g.input_len())
        .zip(grad_y.par_chunks(g.output_len()))
        .for_each_init(
            || (Vec::new(), Vec::new()),
            |(border, scratch), (grad_x, grad_y)| {
                let (height, width, k) = (g.out_height(), g.out_width(), 9 * inc);
                scratch.resize(height * width * k, 0.0);
                product(
                    [height * width, k, outc],
                    grad_y,
                    View::rows(0, outc),
                    weight,
                    View::columns(0, outc),
                    scratch,
                    View::rows(0, k),
                    false,
                );
                let row = (g.width + 2) * inc;
                border.clear();
                border.resize((g.height + 2) * row, 0.0);
                for y in 0..height {
                    for x in 0..width {
                        let from = (y * width + x) * k;
                        for dy in 0..3 {
                            let to = (2 * y + dy) * row + 2 * x * inc;
                            let run = &scratch[from + dy * 3 * inc..from + (dy + 1) * 3 * inc];
                            for (sum, value) in border[to..to + 3 * inc].iter_mut().zip(run) {
                                *sum += value;
                            }
                        }
                    }
                }
                for y in 0..g.height {
                    let from = (y + 1) * row + inc;
                    grad_x[y * g.width * inc..(y + 1) * g.width * inc]
                        .copy_from_slice(&border[from..from + g.width * inc]);
                }
            },
        );
    grad_x
}

/// Pictures whose weight gradients are summed together on one thread; fixed, so that the sum does not depend on threads.
const PICTURES_PER_SUM: usize = 6;

/// Gradient with respect to the weights, summed over the batch.
pub fn grad_weight(geometry: &Geometry, x: &[f32], grad_y: &[f32]) -> Vec<f32> {
    let g = *geometry;
    let (inc, outc) = (g.in_channels, g.out_channels);
    let parts: Vec<Vec<f32>> = x
        .par_chunks(g.input_len() * PICTURES_PER_SUM)
        .zip(grad_y.par_chunks(g.output_len() * PICTURES_PER_SUM))
        .map(|(x, grad_y)| {
            let mut sum = vec![0.0; g.weight_len()];
            let (mut border, mut scratch) = (Vec::new(), Vec::new());
            for (x, grad_y) in x.chunks(g.input_len()).zip(grad_y.chunks(g.output_len())) {
                padded(x, g.height, g.width, inc, &mut border);
                if g.stride == 1 {
                    // The gradient is padded as the input is, so that its border cancels the padding columns.
                    padded(grad_y, g.height, g.width, outc, &mut scratch);
                    let padded_width = g.width + 2;
                    for dy in 0..3 {
                        product(
                            [3 * inc, outc, g.height * padded_width],
                            &border,
                            View::columns(dy * padded_width * inc, inc),
                            &scratch,
                            View::rows((padded_width + 1) * outc, outc),
                            &mut sum,
                            View::rows(dy * 3 * inc * outc, outc),
                            true,
                        );
                    }
                } else {
                    windows(&border, &g, &mut scratch);
                    let k = 9 * inc;
                    product(
                        [k, outc, g.out_height() * g.out_width()],
                        &scratch,
                        View::columns(0, k),
                        grad_y,
                        View::rows(0, outc),
                        &mut sum,
                        View::rows(0, outc),
                        true,
                    );
                }
            }
            sum
        })
        .collect();
    let mut total = vec![0.0; g.weight_len()];
    for part in parts {
        for (sum, value) in total.iter_mut().zip(part) {
            *sum += value;
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(n: usize, seed: usize) -> Vec<f32> {
        (0..n)
            .map(|i| (((i * 7919 + seed * 104_729) % 1009) as f32 / 504.5) - 1.0)
            .collect()
    }

    fn plain(g: &Geometry, x: &[f32], w: &[f32]) -> Vec<f32> {
        let mut y = vec![0.0; g.batch * g.output_len()];
        let (oh, ow) = (g.out_height(), g.out_width());
        for b in 0..g.batch {
            for i in 0..oh {
                for j in 0..ow {
                    for o in 0..g.out_channels {
                        let mut sum = 0.0f64;
                        for dy in 0..3 {
                            for dx in 0..3 {
                                let (yy, xx) = (
                                    (g.stride * i + dy) as isize - 1,
                                    (g.stride * j + dx) as isize - 1,
                                );
                                if yy < 0
                                    || xx < 0
                                    || yy >= g.height as isize
                                    || xx >= g.width as isize
                                {
                                    continue;
                                }
                                for c in 0..g.in_channels {
                                    let xi = ((b * g.height + yy as usize) * g.width + xx as usize)
                                        * g.in_channels
                                        + c;
                                    let wi =
                                        ((dy * 3 + dx) * g.in_channels + c) * g.out_channels + o;
                                    sum += f64::from(x[xi]) * f64::from(w[wi]);
                                }
                            }
                        }
                        y[((b * oh + i) * ow + j) * g.out_channels + o] = sum as f32;
                    }
                }
            }
        }
        y
    }

    /// The gradients are the adjoints of the forward pass: <grad, forward(dx)> == <backward(grad), dx>.
    #[test]
    fn forward_is_plain_convolution_and_gradients_are_its_adjoints() {
        for (stride, inc, outc, height, width) in [
            (1, 5, 7, 6, 10),
            (2, 3, 16, 8, 12),
            (1, 16, 16, 12, 4),
            (2, 16, 8, 6, 6),
        ] {
            let g = Geometry {
                batch: 7,
                height,
                width,
                in_channels: inc,
                out_channels: outc,
                stride,
            };
            let (x, w) = (
                values(g.batch * g.input_len(), 1),
                values(g.weight_len(), 2),
            );
            let y = forward(&g, &x, &w);
            for (a, b) in y.iter().zip(plain(&g, &x, &w)) {
                assert!((a - b).abs() < 1e-4);
            }
            let grad = values(y.len(), 3);
            let dot = |a: &[f32], b: &[f32]| -> f64 {
                a.iter()
                    .zip(b)
                    .map(|(a, b)| f64::from(*a) * f64::from(*b))
                    .sum()
            };
            let expected = dot(&grad, &y);
            assert!(
                (dot(&grad_input(&g, &grad, &w), &x) - expected).abs()
                    < 1e-2 + expected.abs() * 1e-4
            );
            assert!(
                (dot(&grad_weight(&g, &x, &grad), &w) - expected).abs()
                    < 1e-2 + expected.abs() * 1e-4
            );
            // Beyond the one direction of the dot product: gradients at single places against finite differences.
            for at in [0, w.len() / 2, w.len() - 1] {
                let mut moved = w.clone();
                moved[at] += 1.0;
                let change = dot(&grad, &plain(&g, &x, &moved)) - expected;
                assert!((f64::from(grad_weight(&g, &x, &grad)[at]) - change).abs() < 1e-2);
            }
            for at in [0, x.len() / 2, x.len() - 1] {
                let mut moved = x.clone();
                moved[at] += 1.0;
                let change = dot(&grad, &plain(&g, &moved, &w)) - expected;
                assert!((f64::from(grad_input(&g, &grad, &w)[at]) - change).abs() < 1e-2);
            }
        }
    }
}
