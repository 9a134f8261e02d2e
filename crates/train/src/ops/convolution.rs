//! 3x3 convolution (padding 1, stride 1 or 2) and its gradients on NHWC batches, for the CPU.
//!
//! Weights are `[out, in, 3, 3]`. Stride 1 uses Winograd's algorithm ([`grimnet_kernels::train`]); stride 2 and narrow layers use
//! im2col.

use grimnet_kernels::Isa;
use grimnet_kernels::strided_product::{View, product};
use grimnet_kernels::train::{BatchConvSpec, conv3x3, conv3x3_grad_input, conv3x3_grad_weight};
use rayon::prelude::*;

/// Layers with at most this many input or output channels use im2col: padding to blocks of 16 costs more than Winograd saves.
const NARROW_CHANNELS: usize = 8;

/// Sizes of a convolution over a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// Number of pictures.
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

/// Whether a layer uses Winograd's algorithm.
fn by_winograd(g: &Geometry) -> bool {
    g.stride == 1 && g.in_channels.min(g.out_channels) > NARROW_CHANNELS
}

fn batch_spec(g: &Geometry) -> BatchConvSpec {
    BatchConvSpec {
        batch: g.batch,
        height: g.height,
        width: g.width,
        in_channels: g.in_channels,
        out_channels: g.out_channels,
    }
}

/// `[out, in, 9]` to `[9, in, out]`: the order of the gathered windows.
fn tap_major(g: &Geometry, weight: &[f32]) -> Vec<f32> {
    let (inputs, outputs) = (g.in_channels, g.out_channels);
    let mut taps = vec![0.0; weight.len()];
    for (o, kernels) in weight.chunks_exact(9 * inputs).enumerate() {
        for (c, kernel) in kernels.chunks_exact(9).enumerate() {
            for (tap, value) in kernel.iter().enumerate() {
                taps[(tap * inputs + c) * outputs + o] = *value;
            }
        }
    }
    taps
}

/// `[9, in, out]` to `[out, in, 9]`.
fn oihw(g: &Geometry, taps: &[f32]) -> Vec<f32> {
    let (inputs, outputs) = (g.in_channels, g.out_channels);
    let mut weight = vec![0.0; taps.len()];
    for (row, values) in taps.chunks_exact(outputs).enumerate() {
        let (tap, c) = (row / inputs, row % inputs);
        for (o, value) in values.iter().enumerate() {
            weight[(o * inputs + c) * 9 + tap] = *value;
        }
    }
    weight
}

/// A picture with a border of zeros, one pixel wide.
fn padded(picture: &[f32], g: &Geometry, out: &mut Vec<f32>) {
    let (line, row) = (g.width * g.in_channels, (g.width + 2) * g.in_channels);
    out.clear();
    out.resize((g.height + 2) * row, 0.0);
    for (y, pixels) in picture.chunks_exact(line).enumerate() {
        let at = (y + 1) * row + g.in_channels;
        out[at..at + line].copy_from_slice(pixels);
    }
}

/// For each output pixel and row of its window, the offsets of that row in the matrix of windows (rows of 9 x channels) and in
/// the padded picture. A row is three pixels long.
fn window_rows(g: &Geometry) -> impl Iterator<Item = (usize, usize)> {
    let (c, row, stride) = (g.in_channels, (g.width + 2) * g.in_channels, g.stride);
    let width = g.out_width();
    (0..g.out_height() * width).flat_map(move |pixel| {
        let (y, x) = (stride * (pixel / width), stride * (pixel % width));
        (0..3).map(move |dy| ((3 * pixel + dy) * 3 * c, (y + dy) * row + x * c))
    })
}

/// The windows of a picture as rows of 9 x channels.
fn windows(picture: &[f32], g: &Geometry, border: &mut Vec<f32>, out: &mut Vec<f32>) {
    padded(picture, g, border);
    let run = 3 * g.in_channels;
    out.resize(3 * run * g.out_height() * g.out_width(), 0.0);
    for (to, from) in window_rows(g) {
        out[to..to + run].copy_from_slice(&border[from..from + run]);
    }
}

/// Adds windows to the pixels that they were gathered from.
fn add_windows(windows: &[f32], g: &Geometry, border: &mut Vec<f32>, picture: &mut [f32]) {
    let (line, row) = (g.width * g.in_channels, (g.width + 2) * g.in_channels);
    let run = 3 * g.in_channels;
    border.clear();
    border.resize((g.height + 2) * row, 0.0);
    for (from, to) in window_rows(g) {
        let values = &windows[from..from + run];
        for (sum, value) in border[to..to + run].iter_mut().zip(values) {
            *sum += value;
        }
    }
    for (y, pixels) in picture.chunks_exact_mut(line).enumerate() {
        let from = (y + 1) * row + g.in_channels;
        pixels.copy_from_slice(&border[from..from + line]);
    }
}

/// Forward: `y[b, i, j, o] = sum x[b, s*i + dy - 1, s*j + dx - 1, c] * w[o, c, dy, dx]`.
pub fn forward(geometry: &Geometry, x: &[f32], weight: &[f32]) -> Vec<f32> {
    let g = *geometry;
    let mut y = vec![0.0; g.batch * g.output_len()];
    if by_winograd(&g) {
        conv3x3(Isa::detect(), batch_spec(&g), x, weight, &mut y);
        return y;
    }
    let (taps, k) = (tap_major(&g, weight), 9 * g.in_channels);
    y.par_chunks_mut(g.output_len())
        .zip(x.par_chunks(g.input_len()))
        .for_each_init(
            || (Vec::new(), Vec::new()),
            |(border, scratch), (y, x)| {
                windows(x, &g, border, scratch);
                product(
                    [g.out_height() * g.out_width(), g.out_channels, k],
                    scratch,
                    View::rows(0, k),
                    &taps,
                    View::rows(0, g.out_channels),
                    y,
                    View::rows(0, g.out_channels),
                    false,
                );
            },
        );
    y
}

/// Gradient with respect to the input.
pub fn grad_input(geometry: &Geometry, grad_y: &[f32], weight: &[f32]) -> Vec<f32> {
    let g = *geometry;
    let mut grad_x = vec![0.0; g.batch * g.input_len()];
    if by_winograd(&g) {
        conv3x3_grad_input(Isa::detect(), batch_spec(&g), grad_y, weight, &mut grad_x);
        return grad_x;
    }
    let (taps, k) = (tap_major(&g, weight), 9 * g.in_channels);
    let pixels = g.out_height() * g.out_width();
    grad_x
        .par_chunks_mut(g.input_len())
        .zip(grad_y.par_chunks(g.output_len()))
        .for_each_init(
            || (Vec::new(), Vec::new()),
            |(border, scratch), (grad_x, grad_y)| {
                scratch.resize(pixels * k, 0.0);
                product(
                    [pixels, k, g.out_channels],
                    grad_y,
                    View::rows(0, g.out_channels),
                    &taps,
                    View::columns(0, g.out_channels),
                    scratch,
                    View::rows(0, k),
                    false,
                );
                add_windows(scratch, &g, border, grad_x);
            },
        );
    grad_x
}

/// Number of parts of a batch whose weight gradients are summed separately; fixed, so that the sum does not depend on threads.
const PARTIAL_SUMS: usize = 4;

/// Gradient with respect to the weights, summed over the batch.
pub fn grad_weight(geometry: &Geometry, x: &[f32], grad_y: &[f32]) -> Vec<f32> {
    let g = *geometry;
    if by_winograd(&g) {
        let mut grad = vec![0.0; g.weight_len()];
        conv3x3_grad_weight(Isa::detect(), batch_spec(&g), x, grad_y, &mut grad);
        return grad;
    }
    let (pixels, k) = (g.out_height() * g.out_width(), 9 * g.in_channels);
    let pictures = g.batch.div_ceil(PARTIAL_SUMS).max(1);
    let parts: Vec<Vec<f32>> = x
        .par_chunks(g.input_len() * pictures)
        .zip(grad_y.par_chunks(g.output_len() * pictures))
        .map(|(x, grad_y)| {
            let mut sum = vec![0.0; g.weight_len()];
            let (mut border, mut scratch) = (Vec::new(), Vec::new());
            for (x, grad_y) in x.chunks(g.input_len()).zip(grad_y.chunks(g.output_len())) {
                windows(x, &g, &mut border, &mut scratch);
                product(
                    [k, g.out_channels, pixels],
                    &scratch,
                    View::columns(0, k),
                    grad_y,
                    View::rows(0, g.out_channels),
                    &mut sum,
                    View::rows(0, g.out_channels),
                    true,
                );
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
    oihw(&g, &total)
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
                                    let wi = (o * g.in_channels + c) * 9 + dy * 3 + dx;
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
            (1, 20, 33, 6, 10),
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
            // Single elements of the gradients against finite differences.
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
