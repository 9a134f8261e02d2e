//! Convolution for training: forward and both gradients on contiguous NCHW batches.
//!
//! All slices are row-major: activations `[batch, channels, height, width]`, weights `[out, in, kernel, kernel]`. The
//! padding is `kernel / 2`. Outputs are overwritten, not accumulated.

mod direct;
mod tiles;
mod winograd;

use std::sync::{Mutex, PoisonError};

use crate::buffer::AlignedBuffer;
use crate::winograd::{Direction, WinogradWeights, convolve};
use crate::{ConvSpec, Isa, Workspace};
use tiles::{BatchShape, BatchSink, BatchSource, GradientSource};

/// Up to this many channels on either side, the padding to blocks of 16 costs more than Winograd saves.
const NARROW_CHANNELS: usize = 8;

/// What a call needs besides its arguments, kept for the next one.
#[derive(Default)]
struct Memory {
    workspace: Workspace,
    weights: WinogradWeights,
    points: AlignedBuffer,
    direct: direct::Memory,
}

/// Runs `work` with memory of an earlier call, if one is free.
fn with_memory<R>(work: impl FnOnce(&mut Memory) -> R) -> R {
    static FREE: Mutex<Vec<Memory>> = Mutex::new(Vec::new());
    // Poisoning says nothing about memory that holds anything.
    let free = || FREE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut memory = free().pop().unwrap_or_default();
    let result = work(&mut memory);
    free().push(memory);
    result
}

fn by_winograd(spec: ConvSpec) -> bool {
    spec.kernel == 3
        && spec.stride == 1
        && spec.in_channels.min(spec.out_channels) > NARROW_CHANNELS
}

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

/// `y = weight * x`, without bias. `x` is `[batch, in, h, w]`, `y` is `[batch, out, ceil(h/stride), ceil(w/stride)]`.
///
/// # Panics
/// If a slice has the wrong length or the convolution is not supported.
#[allow(clippy::too_many_arguments)]
pub fn conv2d(
    isa: Isa,
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    x: &[f32],
    weight: &[f32],
    y: &mut [f32],
) {
    check(spec, batch, h, w, x.len(), weight.len(), y.len());
    if y.is_empty() {
        return;
    }
    with_memory(
        |Memory {
             workspace,
             weights,
             direct,
             ..
         }| {
            if !by_winograd(spec) {
                return direct::conv2d(isa, spec, (h, w), x, weight, y, direct);
            }
            let shape = |channels| BatchShape {
                batch,
                channels,
                height: h,
                width: w,
            };
            let source = BatchSource {
                shape: shape(spec.in_channels),
                data: x,
            };
            let sink = BatchSink::new(shape(spec.out_channels), y);
            let (outputs, inputs) = (spec.out_channels, spec.in_channels);
            weights.set(
                isa,
                Direction::Forward,
                outputs,
                inputs,
                weight,
                &mut workspace.workers,
            );
            convolve(weights, source.shape.tiles(), &source, &sink, workspace);
        },
    );
}

/// Gradient of [`conv2d`] with respect to its input. `grad_x` is `[batch, in, h, w]`.
///
/// # Panics
/// If a slice has the wrong length or the convolution is not supported.
#[allow(clippy::too_many_arguments)]
pub fn conv2d_grad_input(
    isa: Isa,
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    grad_y: &[f32],
    weight: &[f32],
    grad_x: &mut [f32],
) {
    check(spec, batch, h, w, grad_x.len(), weight.len(), grad_y.len());
    if grad_x.is_empty() {
        return;
    }
    with_memory(
        |Memory {
             workspace,
             weights,
             direct,
             ..
         }| {
            if !by_winograd(spec) {
                return direct::grad_input(isa, spec, (h, w), grad_y, weight, grad_x, direct);
            }
            let shape = |channels| BatchShape {
                batch,
                channels,
                height: h,
                width: w,
            };
            let source = BatchSource {
                shape: shape(spec.out_channels),
                data: grad_y,
            };
            let sink = BatchSink::new(shape(spec.in_channels), grad_x);
            let (outputs, inputs) = (spec.out_channels, spec.in_channels);
            weights.set(
                isa,
                Direction::Backward,
                outputs,
                inputs,
                weight,
                &mut workspace.workers,
            );
            convolve(weights, source.shape.tiles(), &source, &sink, workspace);
        },
    );
}

/// Gradient of [`conv2d`] with respect to its weight, summed over the batch. `grad_weight` is `[out, in, k, k]`.
///
/// # Panics
/// If a slice has the wrong length or the convolution is not supported.
#[allow(clippy::too_many_arguments)]
pub fn conv2d_grad_weight(
    isa: Isa,
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    x: &[f32],
    grad_y: &[f32],
    grad_weight: &mut [f32],
) {
    check(spec, batch, h, w, x.len(), grad_weight.len(), grad_y.len());
    if x.is_empty() {
        grad_weight.fill(0.0);
        return;
    }
    with_memory(
        |Memory {
             workspace,
             points,
             direct,
             ..
         }| {
            if !by_winograd(spec) {
                return direct::grad_weight(isa, spec, (h, w), x, grad_y, grad_weight, direct);
            }
            let shape = |channels| BatchShape {
                batch,
                channels,
                height: h,
                width: w,
            };
            let x = BatchSource {
                shape: shape(spec.in_channels),
                data: x,
            };
            let grad_y = GradientSource {
                shape: shape(spec.out_channels),
                data: grad_y,
            };
            winograd::grad_weight(isa, &x, &grad_y, grad_weight, points, workspace);
        },
    );
}
