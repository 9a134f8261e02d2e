//! 3x3 convolution for training, stride 1 and padding 1: forward pass and both gradients, on contiguous NHWC batches.
//!
//! All slices are row-major: activations `[batch, height, width, channels]`, weights `[out, in, 3, 3]`. Outputs are
//! overwritten, not accumulated.

mod tiles;
mod winograd;

use std::sync::{Mutex, PoisonError};

use crate::buffer::AlignedBuffer;
use crate::winograd::{Direction, WinogradWeights, convolve};
use crate::{Isa, Workspace};
use tiles::{Batch, BatchShape, BatchSink};

/// Sizes of a 3x3 convolution over a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BatchConvSpec {
    /// Images in the batch.
    pub batch: usize,
    /// Height of the images, pixels.
    pub height: usize,
    /// Width of the images, pixels.
    pub width: usize,
    /// Channels of the input.
    pub in_channels: usize,
    /// Channels of the output.
    pub out_channels: usize,
}

impl BatchConvSpec {
    /// Number of weights, `9 * in_channels * out_channels`. One that does not fit `usize` is `usize::MAX`, which no slice has.
    pub fn weight_len(&self) -> usize {
        let channels = self.in_channels.saturating_mul(self.out_channels);
        channels.saturating_mul(9)
    }

    fn of_channels(&self, channels: usize) -> BatchShape {
        BatchShape {
            batch: self.batch,
            channels,
            height: self.height,
            width: self.width,
        }
    }
}

/// Scratch memory of a call, kept for the next one.
#[derive(Default)]
struct Memory {
    workspace: Workspace,
    weights: WinogradWeights,
    points: AlignedBuffer,
}

/// Runs `work` with the memory of an earlier call, if one is free.
fn with_memory<R>(work: impl FnOnce(&mut Memory) -> R) -> R {
    static FREE: Mutex<Vec<Memory>> = Mutex::new(Vec::new());
    // The contents of scratch memory are arbitrary, so a poisoned lock does no harm.
    let free = || FREE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut memory = free().pop().unwrap_or_default();
    let result = work(&mut memory);
    free().push(memory);
    result
}

/// `y = weight * x`, without bias.
///
/// # Panics
/// If a slice has the wrong length.
pub fn conv3x3(isa: Isa, spec: BatchConvSpec, x: &[f32], weight: &[f32], y: &mut [f32]) {
    convolve_batch(isa, spec, Direction::Forward, x, weight, y);
}

/// Gradient of [`conv3x3`] with respect to its input.
///
/// # Panics
/// If a slice has the wrong length.
pub fn conv3x3_grad_input(
    isa: Isa,
    spec: BatchConvSpec,
    grad_y: &[f32],
    weight: &[f32],
    grad_x: &mut [f32],
) {
    convolve_batch(isa, spec, Direction::Backward, grad_y, weight, grad_x);
}

fn convolve_batch(
    isa: Isa,
    spec: BatchConvSpec,
    direction: Direction,
    from: &[f32],
    weight: &[f32],
    to: &mut [f32],
) {
    assert_eq!(weight.len(), spec.weight_len(), "elements of the weight");
    let (inputs, outputs) = match direction {
        Direction::Forward => (spec.in_channels, spec.out_channels),
        Direction::Backward => (spec.out_channels, spec.in_channels),
    };
    let source = Batch::new(spec.of_channels(inputs), from);
    let sink = BatchSink::new(spec.of_channels(outputs), to);
    with_memory(
        |Memory {
             workspace, weights, ..
         }| {
            let scratch = &mut workspace.workers;
            let (outputs, inputs) = (spec.out_channels, spec.in_channels);
            weights.set(isa, direction, outputs, inputs, weight, scratch);
            convolve(weights, source.shape().tiles(), &source, &sink, workspace);
        },
    );
}

/// Gradient of [`conv3x3`] with respect to its weight, summed over the batch.
///
/// # Panics
/// If a slice has the wrong length.
pub fn conv3x3_grad_weight(
    isa: Isa,
    spec: BatchConvSpec,
    x: &[f32],
    grad_y: &[f32],
    grad_weight: &mut [f32],
) {
    assert_eq!(
        grad_weight.len(),
        spec.weight_len(),
        "elements of the weight"
    );
    let x = Batch::new(spec.of_channels(spec.in_channels), x);
    let grad_y = Batch::new(spec.of_channels(spec.out_channels), grad_y);
    if x.shape().tiles() == 0 {
        grad_weight.fill(0.0);
        return;
    }
    with_memory(
        |Memory {
             workspace, points, ..
         }| winograd::grad_weight(isa, &x, &grad_y, grad_weight, points, workspace),
    );
}
