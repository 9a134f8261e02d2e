//! Batch normalisation followed by ReLU over rows of channels (NHWC), with statistics per group of rows, for the CPU.
//!
//! The rows of a group share statistics: all pictures of one domain (DA-BN; paper, eq. 3), or one picture.

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
/// Channels that are summed in parallel in registers.
const LANES: usize = 16;

/// Two sums over the rows for each channel. `terms(row, first channel, a, b, width)` adds the terms of `width` channels of a row
/// to `a` and `b`.
fn sums<const WHOLE: bool>(
    rows: usize,
    channels: usize,
    terms: &(impl Fn(usize, usize, &mut [f32; LANES], &mut [f32; LANES], usize) + Sync),
) -> (Vec<f64>, Vec<f64>) {
    let chunks: Vec<(Vec<f32>, Vec<f32>)> = (0..rows.div_ceil(CHUNK_ROWS))
        .into_par_iter()
        .map(|chunk| {
            let (mut all_a, mut all_b) = (vec![0.0; channels], vec![0.0; channels]);
            for first in (0..channels).step_by(LANES) {
                let width = if WHOLE {
                    LANES
                } else {
                    LANES.min(channels - first)
                };
                let (mut a, mut b) = ([0.0; LANES], [0.0; LANES]);
                for row in chunk * CHUNK_ROWS..((chunk + 1) * CHUNK_ROWS).min(rows) {
                    terms(row, first, &mut a, &mut b, width);
                }
                all_a[first..first + width].copy_from_slice(&a[..width]);
                all_b[first..first + width].copy_from_slice(&b[..width]);
            }
            (all_a, all_b)
        })
        .collect();
    let (mut a, mut b) = (vec![0.0f64; channels], vec![0.0f64; channels]);
    for (x, y) in chunks {
        for c in 0..channels {
            a[c] += f64::from(x[c]);
            b[c] += f64::from(y[c]);
        }
    }
    (a, b)
}

/// Sum and sum of squares of each channel.
fn moment_sums(x: &[f32], rows: usize, channels: usize) -> (Vec<f64>, Vec<f64>) {
    let whole = |row: usize, first: usize, a: &mut [f32; LANES], b: &mut [f32; LANES], _: usize| {
        if let Some(x) = x[row * channels + first..].first_chunk::<LANES>() {
            for i in 0..LANES {
                a[i] += x[i];
                b[i] += x[i] * x[i];
            }
        }
    };
    let part =
        |row: usize, first: usize, a: &mut [f32; LANES], b: &mut [f32; LANES], width: usize| {
            for (i, x) in x[row * channels + first..][..width].iter().enumerate() {
                a[i] += x;
                b[i] += x * x;
            }
        };
    if channels.is_multiple_of(LANES) {
        sums::<true>(rows, channels, &whole)
    } else {
        sums::<false>(rows, channels, &part)
    }
}

/// Sums of the gradient before the ReLU, and of that gradient times x, for each channel.
fn gradient_sums(
    x: &[f32],
    grad: &[f32],
    scale: &[f32],
    shift: &[f32],
    rows: usize,
    channels: usize,
) -> (Vec<f64>, Vec<f64>) {
    let whole = |row: usize, first: usize, a: &mut [f32; LANES], b: &mut [f32; LANES], _: usize| {
        let at = row * channels + first;
        if let (Some(x), Some(grad), Some(scale), Some(shift)) = (
            x[at..].first_chunk::<LANES>(),
            grad[at..].first_chunk::<LANES>(),
            scale[first..].first_chunk::<LANES>(),
            shift[first..].first_chunk::<LANES>(),
        ) {
            for i in 0..LANES {
                let g = if x[i] * scale[i] + shift[i] > 0.0 {
                    grad[i]
                } else {
                    0.0
                };
                a[i] += g;
                b[i] += g * x[i];
            }
        }
    };
    let part =
        |row: usize, first: usize, a: &mut [f32; LANES], b: &mut [f32; LANES], width: usize| {
            for i in 0..width {
                let (at, c) = (row * channels + first + i, first + i);
                let g = if x[at] * scale[c] + shift[c] > 0.0 {
                    grad[at]
                } else {
                    0.0
                };
                a[i] += g;
                b[i] += g * x[at];
            }
        };
    if channels.is_multiple_of(LANES) {
        sums::<true>(rows, channels, &whole)
    } else {
        sums::<false>(rows, channels, &part)
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
    let mut y = vec![0.0; x.len()];
    let mut moments = Moments::default();
    let mut start = 0;
    for group in groups {
        let span = start..start + group.rows * channels;
        start = span.end;
        let (x, y) = (&x[span.clone()], &mut y[span]);
        let (sum, squares) = moment_sums(x, group.rows, channels);
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
        y.par_chunks_mut(CHUNK_ROWS * channels)
            .zip(x.par_chunks(CHUNK_ROWS * channels))
            .for_each(|(y, x)| {
                for (y, x) in y.chunks_exact_mut(channels).zip(x.chunks_exact(channels)) {
                    for (((y, x), scale), shift) in y.iter_mut().zip(x).zip(&scale).zip(&shift) {
                        *y = (x * scale + shift).max(0.0);
                    }
                }
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
        let (sum, product) = gradient_sums(x, grad_y, &scale, &shift, group.rows, channels);
        let n = group.rows as f64;
        // grad_x = scale * (g - mean(g) - xhat * mean(g * xhat)) = scale * g + slope * x + offset
        let mut slope = vec![0.0; channels];
        let mut offset = vec![0.0; channels];
        for c in 0..channels {
            let along = (product[c] - f64::from(mean[c]) * sum[c]) * f64::from(inverse[c]);
            grad_gamma[affine.start + c] += along as f32;
            grad_beta[affine.start + c] += sum[c] as f32;
            let k = -f64::from(scale[c]) * along / n * f64::from(inverse[c]);
            slope[c] = k as f32;
            offset[c] = (-f64::from(scale[c]) * sum[c] / n - k * f64::from(mean[c])) as f32;
        }
        let span = CHUNK_ROWS * channels;
        grad_x
            .par_chunks_mut(span)
            .zip(x.par_chunks(span))
            .zip(grad_y.par_chunks(span))
            .for_each(|((out, x), g)| {
                for ((out, x), g) in out
                    .chunks_exact_mut(channels)
                    .zip(x.chunks_exact(channels))
                    .zip(g.chunks_exact(channels))
                {
                    let (x, g, out) = (&x[..channels], &g[..channels], &mut out[..channels]);
                    let (scale, shift) = (&scale[..channels], &shift[..channels]);
                    let (slope, offset) = (&slope[..channels], &offset[..channels]);
                    for c in 0..channels {
                        let g = if x[c] * scale[c] + shift[c] > 0.0 {
                            g[c]
                        } else {
                            0.0
                        };
                        out[c] = scale[c] * g + slope[c] * x[c] + offset[c];
                    }
                }
            });
    }
    (grad_x, grad_gamma, grad_beta)
}
