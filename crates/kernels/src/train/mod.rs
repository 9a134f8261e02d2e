//! Convolution for training: forward and both gradients on contiguous NCHW batches.
//!
//! All slices are row-major: activations `[batch, channels, height, width]`, weights `[out, in, kernel, kernel]`. The
//! padding is `kernel / 2`. Outputs are overwritten, not accumulated.

use rayon::prelude::*;

use crate::{ConvSpec, Isa};

fn check(spec: ConvSpec, batch: usize, h: usize, w: usize, x: usize, weight: usize, y: usize) {
    let (oh, ow) = (spec.output_size(h), spec.output_size(w));
    assert!(spec.validate().is_ok(), "unsupported convolution {spec:?}");
    assert_eq!(
        x,
        batch * spec.in_channels * h * w,
        "elements of the input side"
    );
    assert_eq!(
        y,
        batch * spec.out_channels * oh * ow,
        "elements of the output side"
    );
    assert_eq!(weight, spec.weight_len(), "elements of the weight");
}

/// Input coordinate of an output coordinate and a kernel tap, if it lies inside.
fn input_of(out: usize, tap: usize, spec: ConvSpec, size: usize) -> Option<usize> {
    (out * spec.stride + tap)
        .checked_sub(spec.kernel / 2)
        .filter(|&i| i < size)
}

/// `y = weight * x`, without bias. `x` is `[batch, in, h, w]`, `y` is `[batch, out, ceil(h/stride), ceil(w/stride)]`.
///
/// # Panics
/// If a slice has the wrong length or the convolution is not supported.
#[allow(clippy::too_many_arguments)]
pub fn conv2d(
    _isa: Isa,
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    x: &[f32],
    weight: &[f32],
    y: &mut [f32],
) {
    check(spec, batch, h, w, x.len(), weight.len(), y.len());
    let (oh, ow, k) = (spec.output_size(h), spec.output_size(w), spec.kernel);
    if y.is_empty() {
        return;
    }
    y.par_chunks_exact_mut(oh * ow)
        .enumerate()
        .for_each(|(plane, y)| {
            let (b, o) = (plane / spec.out_channels, plane % spec.out_channels);
            y.fill(0.0);
            for i in 0..spec.in_channels {
                let x = &x[(b * spec.in_channels + i) * h * w..][..h * w];
                for (tap, weight) in weight[(o * spec.in_channels + i) * k * k..][..k * k]
                    .iter()
                    .enumerate()
                {
                    for oy in 0..oh {
                        let Some(iy) = input_of(oy, tap / k, spec, h) else {
                            continue;
                        };
                        for ox in 0..ow {
                            let Some(ix) = input_of(ox, tap % k, spec, w) else {
                                continue;
                            };
                            y[oy * ow + ox] += weight * x[iy * w + ix];
                        }
                    }
                }
            }
        });
}

/// Gradient of [`conv2d`] with respect to its input. `grad_x` is `[batch, in, h, w]`.
///
/// # Panics
/// If a slice has the wrong length or the convolution is not supported.
#[allow(clippy::too_many_arguments)]
pub fn conv2d_grad_input(
    _isa: Isa,
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    grad_y: &[f32],
    weight: &[f32],
    grad_x: &mut [f32],
) {
    check(spec, batch, h, w, grad_x.len(), weight.len(), grad_y.len());
    let (oh, ow, k) = (spec.output_size(h), spec.output_size(w), spec.kernel);
    if grad_x.is_empty() {
        return;
    }
    grad_x
        .par_chunks_exact_mut(h * w)
        .enumerate()
        .for_each(|(plane, grad_x)| {
            let (b, i) = (plane / spec.in_channels, plane % spec.in_channels);
            grad_x.fill(0.0);
            for o in 0..spec.out_channels {
                let grad_y = &grad_y[(b * spec.out_channels + o) * oh * ow..][..oh * ow];
                for (tap, weight) in weight[(o * spec.in_channels + i) * k * k..][..k * k]
                    .iter()
                    .enumerate()
                {
                    for oy in 0..oh {
                        let Some(iy) = input_of(oy, tap / k, spec, h) else {
                            continue;
                        };
                        for ox in 0..ow {
                            let Some(ix) = input_of(ox, tap % k, spec, w) else {
                                continue;
                            };
                            grad_x[iy * w + ix] += weight * grad_y[oy * ow + ox];
                        }
                    }
                }
            }
        });
}

/// Gradient of [`conv2d`] with respect to its weight, summed over the batch. `grad_weight` is `[out, in, k, k]`.
///
/// # Panics
/// If a slice has the wrong length or the convolution is not supported.
#[allow(clippy::too_many_arguments)]
pub fn conv2d_grad_weight(
    _isa: Isa,
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    x: &[f32],
    grad_y: &[f32],
    grad_weight: &mut [f32],
) {
    check(spec, batch, h, w, x.len(), grad_weight.len(), grad_y.len());
    let (oh, ow, k) = (spec.output_size(h), spec.output_size(w), spec.kernel);
    grad_weight
        .par_chunks_exact_mut(k * k)
        .enumerate()
        .for_each(|(pair, grad_weight)| {
            let (o, i) = (pair / spec.in_channels, pair % spec.in_channels);
            for (tap, grad) in grad_weight.iter_mut().enumerate() {
                let mut sum = 0.0f64;
                for b in 0..batch {
                    let x = &x[(b * spec.in_channels + i) * h * w..][..h * w];
                    let grad_y = &grad_y[(b * spec.out_channels + o) * oh * ow..][..oh * ow];
                    for oy in 0..oh {
                        let Some(iy) = input_of(oy, tap / k, spec, h) else {
                            continue;
                        };
                        for ox in 0..ow {
                            let Some(ix) = input_of(ox, tap % k, spec, w) else {
                                continue;
                            };
                            sum += f64::from(grad_y[oy * ow + ox]) * f64::from(x[iy * w + ix]);
                        }
                    }
                }
                *grad = sum as f32;
            }
        });
}
