//! Batch normalisation followed by ReLU over rows of channels (NHWC), with statistics per group of rows, for the CPU.
//!
//! The rows of a group share statistics: all pictures of one domain (DA-BN; paper, eq. 3), or one picture.

use grimnet_kernels::{Isa, PlainKernel};
use rayon::prelude::*;

/// Consecutive rows that share statistics, and the domain of their scale and shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Number of rows (pictures x height x width).
    pub rows: usize,
    /// Row of the affine parameters.
    pub domain: usize,
}

/// Moments of a forward pass: one row of channels for each group.
#[derive(Clone, Debug, Default)]
pub struct Moments {
    /// Mean of each channel.
    pub mean: Vec<f32>,
    /// Biased variance of each channel.
    pub variance: Vec<f32>,
}

/// Rows that are summed in f32; their sums are added in f64. Fixed, so that sums do not depend on the number of threads.
const CHUNK_ROWS: usize = 512;

/// Two sums over the rows for each channel, from those of the chunks in their order.
fn total(chunks: Vec<[Vec<f32>; 2]>, channels: usize) -> [Vec<f64>; 2] {
    let mut total = [vec![0.0f64; channels], vec![0.0f64; channels]];
    for chunk in chunks {
        for (total, chunk) in total.iter_mut().zip(chunk) {
            for (total, sum) in total.iter_mut().zip(chunk) {
                *total += f64::from(sum);
            }
        }
    }
    total
}

/// Sum and sum of squares of each channel over a chunk of rows.
struct MomentSums<'a> {
    x: &'a [f32],
    channels: usize,
}

impl PlainKernel for MomentSums<'_> {
    type Output = [Vec<f32>; 2];
    #[inline(always)]
    fn run(self) -> Self::Output {
        let [mut sum, mut squares] = [vec![0.0; self.channels], vec![0.0; self.channels]];
        for x in self.x.chunks_exact(self.channels) {
            for ((x, sum), squares) in x.iter().zip(&mut sum).zip(&mut squares) {
                *sum += x;
                *squares += x * x;
            }
        }
        [sum, squares]
    }
}

/// Sums of the gradient before the ReLU, and of that gradient times x, for each channel over a chunk of rows.
struct GradientSums<'a> {
    x: &'a [f32],
    grad_y: &'a [f32],
    scale: &'a [f32],
    shift: &'a [f32],
}

impl PlainKernel for GradientSums<'_> {
    type Output = [Vec<f32>; 2];
    #[inline(always)]
    fn run(self) -> Self::Output {
        let channels = self.scale.len();
        let [mut sum, mut products] = [vec![0.0; channels], vec![0.0; channels]];
        for (x, grad_y) in self
            .x
            .chunks_exact(channels)
            .zip(self.grad_y.chunks_exact(channels))
        {
            let (scale, shift) = (&self.scale[..channels], &self.shift[..channels]);
            let (sum, products) = (&mut sum[..channels], &mut products[..channels]);
            for c in 0..channels {
                let grad = before_relu(grad_y[c], x[c] * scale[c] + shift[c]);
                sum[c] += grad;
                products[c] += grad * x[c];
            }
        }
        [sum, products]
    }
}

/// The gradient before a ReLU whose input was `value`.
#[inline(always)]
fn before_relu(grad: f32, value: f32) -> f32 {
    if value > 0.0 { grad } else { 0.0 }
}

/// `y = max(0, scale * x + shift)` over a chunk of rows.
struct ScaleShiftRelu<'a> {
    y: &'a mut [f32],
    x: &'a [f32],
    scale: &'a [f32],
    shift: &'a [f32],
}

impl PlainKernel for ScaleShiftRelu<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let channels = self.scale.len();
        for (y, x) in self
            .y
            .chunks_exact_mut(channels)
            .zip(self.x.chunks_exact(channels))
        {
            for (((y, x), scale), shift) in y.iter_mut().zip(x).zip(self.scale).zip(self.shift) {
                *y = (x * scale + shift).max(0.0);
            }
        }
    }
}

/// `grad_x = scale * g + slope * x + offset` over a chunk of rows, where `g` is the gradient before the ReLU.
struct GradientInput<'a> {
    grad_x: &'a mut [f32],
    x: &'a [f32],
    grad_y: &'a [f32],
    scale: &'a [f32],
    shift: &'a [f32],
    slope: &'a [f32],
    offset: &'a [f32],
}

impl PlainKernel for GradientInput<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let channels = self.scale.len();
        for ((grad_x, x), grad_y) in self
            .grad_x
            .chunks_exact_mut(channels)
            .zip(self.x.chunks_exact(channels))
            .zip(self.grad_y.chunks_exact(channels))
        {
            let (scale, shift) = (&self.scale[..channels], &self.shift[..channels]);
            let (slope, offset) = (&self.slope[..channels], &self.offset[..channels]);
            for c in 0..channels {
                let grad = before_relu(grad_y[c], x[c] * scale[c] + shift[c]);
                grad_x[c] = scale[c] * grad + slope[c] * x[c] + offset[c];
            }
        }
    }
}

/// `y = max(0, gamma * (x - mean) / sqrt(var + eps) + beta)`; `gamma` and `beta` are `[domains, channels]`.
pub fn forward(
    x: &[f32],
    channels: usize,
    groups: &[Group],
    gamma: &[f32],
    beta: &[f32],
    eps: f32,
) -> (Vec<f32>, Moments) {
    let isa = Isa::detect();
    let mut y = vec![0.0; x.len()];
    let mut moments = Moments::default();
    let mut start = 0;
    for group in groups {
        let span = start..start + group.rows * channels;
        start = span.end;
        let (x, y) = (&x[span.clone()], &mut y[span]);
        let chunk = CHUNK_ROWS * channels;
        let [sum, squares] = total(
            x.par_chunks(chunk)
                .map(|x| isa.vectorise(MomentSums { x, channels }))
                .collect(),
            channels,
        );
        let n = group.rows as f64;
        let mean: Vec<f32> = sum.iter().map(|s| (s / n) as f32).collect();
        let variance: Vec<f32> = sum
            .iter()
            .zip(&squares)
            .map(|(s, q)| (q / n - (s / n) * (s / n)).max(0.0) as f32)
            .collect();
        let affine = group.domain * channels..(group.domain + 1) * channels;
        let (gamma, beta) = (&gamma[affine.clone()], &beta[affine]);
        let scale: Vec<f32> = gamma
            .iter()
            .zip(&variance)
            .map(|(g, v)| g / (v + eps).sqrt())
            .collect();
        let shift: Vec<f32> = beta
            .iter()
            .zip(&mean)
            .zip(&scale)
            .map(|((b, m), s)| b - m * s)
            .collect();
        y.par_chunks_mut(chunk)
            .zip(x.par_chunks(chunk))
            .for_each(|(y, x)| {
                isa.vectorise(ScaleShiftRelu {
                    y,
                    x,
                    scale: &scale,
                    shift: &shift,
                });
            });
        moments.mean.extend(mean);
        moments.variance.extend(variance);
    }
    (y, moments)
}

/// Gradients with respect to `x`, `gamma` and `beta`.
#[allow(clippy::too_many_arguments)]
pub fn backward(
    grad_y: &[f32],
    x: &[f32],
    channels: usize,
    groups: &[Group],
    gamma: &[f32],
    beta: &[f32],
    moments: &Moments,
    eps: f32,
) -> (Vec<f32>, Vec<f32>, Vec<f32>) {
    let isa = Isa::detect();
    let mut grad_x = vec![0.0; x.len()];
    let (mut grad_gamma, mut grad_beta) = (vec![0.0; gamma.len()], vec![0.0; beta.len()]);
    let mut start = 0;
    for (index, group) in groups.iter().enumerate() {
        let span = start..start + group.rows * channels;
        start = span.end;
        let (x, grad_y, grad_x) = (&x[span.clone()], &grad_y[span.clone()], &mut grad_x[span]);
        let mean = &moments.mean[index * channels..(index + 1) * channels];
        let inverse: Vec<f32> = moments.variance[index * channels..(index + 1) * channels]
            .iter()
            .map(|v| 1.0 / (v + eps).sqrt())
            .collect();
        let affine = group.domain * channels..(group.domain + 1) * channels;
        let (scale, shift): (Vec<f32>, Vec<f32>) = (0..channels)
            .map(|c| {
                let scale = gamma[affine.start + c] * inverse[c];
                (scale, beta[affine.start + c] - mean[c] * scale)
            })
            .unzip();
        let chunk = CHUNK_ROWS * channels;
        let [sum, products] = total(
            x.par_chunks(chunk)
                .zip(grad_y.par_chunks(chunk))
                .map(|(x, grad_y)| {
                    isa.vectorise(GradientSums {
                        x,
                        grad_y,
                        scale: &scale,
                        shift: &shift,
                    })
                })
                .collect(),
            channels,
        );
        let n = group.rows as f64;
        // grad_x = scale * (g - mean(g) - xhat * mean(g * xhat)) = scale * g + slope * x + offset
        let mut slope = vec![0.0; channels];
        let mut offset = vec![0.0; channels];
        for c in 0..channels {
            let along = (products[c] - f64::from(mean[c]) * sum[c]) * f64::from(inverse[c]);
            grad_gamma[affine.start + c] += along as f32;
            grad_beta[affine.start + c] += sum[c] as f32;
            let k = -f64::from(scale[c]) * along / n * f64::from(inverse[c]);
            slope[c] = k as f32;
            offset[c] = (-f64::from(scale[c]) * sum[c] / n - k * f64::from(mean[c])) as f32;
        }
        grad_x
            .par_chunks_mut(chunk)
            .zip(x.par_chunks(chunk))
            .zip(grad_y.par_chunks(chunk))
            .for_each(|((grad_x, x), grad_y)| {
                isa.vectorise(GradientInput {
                    grad_x,
                    x,
                    grad_y,
                    scale: &scale,
                    shift: &shift,
                    slope: &slope,
                    offset: &offset,
                });
            });
    }
    (grad_x, grad_gamma, grad_beta)
}
