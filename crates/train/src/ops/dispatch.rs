//! The operations as burn operations: forward on the CPU backend, backward registered with autodiff.

use super::composed::{composed_conv3x3, composed_norm_relu, composed_transposed_conv4x4};
use super::convolution::{self, Geometry};
use super::normalisation::{self, Group, Moments};
use burn::backend::autodiff::{
    Autodiff,
    checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
    grads::Gradients,
    ops::{Backward, Ops, OpsKind},
};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, Flex, backend_extension};
use burn::tensor::module::conv_transpose2d;
use burn::tensor::ops::ConvTransposeOptions;
use burn::tensor::{DType, Device, Shape, Tensor, TensorData};
use std::sync::{Arc, Mutex, PoisonError};

/// Settings of the normalisation, and the moments that its forward pass computes.
#[derive(Clone, Debug)]
pub struct NormArguments {
    groups: Arc<Vec<Group>>,
    eps: f32,
    found: Arc<Mutex<Moments>>,
}

/// The operations on a backend.
#[backend_extension(Autodiff, Flex)]
pub trait TrainingOps: Backend {
    /// 3x3 convolution, padding 1; `x` `[n, h, w, c]`, `weight` `[o, c, 3, 3]`.
    fn conv3x3_nhwc(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        stride: usize,
    ) -> FloatTensor<Self>;
    /// Normalisation with the statistics of each group, then ReLU; `x` `[rows, c]`, `gamma` and `beta` `[domains, c]`.
    fn norm_relu_rows(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: FloatTensor<Self>,
        arguments: NormArguments,
    ) -> FloatTensor<Self>;
}

type Cpu = FloatTensor<Flex>;

fn tensor(values: Vec<f32>, shape: &[usize]) -> Cpu {
    Cpu::from_data(TensorData::new(values, Shape::from(shape.to_vec())))
}

/// The values in row-major order.
fn contiguous(tensor: &Cpu) -> Cpu {
    assert_eq!(tensor.dtype(), DType::F32, "training runs in f32");
    tensor.to_contiguous()
}

fn values(tensor: &Cpu) -> &[f32] {
    let n = tensor.layout().shape().num_elements();
    let start = tensor.layout().start_offset();
    &tensor.storage::<f32>()[start..start + n]
}

fn geometry(x: &Cpu, weight: &Cpu, stride: usize) -> Geometry {
    let (x, w) = (x.layout().shape(), weight.layout().shape());
    assert_eq!(w[1], x[3], "weights of another number of channels");
    Geometry {
        batch: x[0],
        height: x[1],
        width: x[2],
        in_channels: x[3],
        out_channels: w[0],
        stride,
    }
}

impl TrainingOps for Flex {
    fn conv3x3_nhwc(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        stride: usize,
    ) -> FloatTensor<Self> {
        let (x, weight) = (contiguous(&x), contiguous(&weight));
        let g = geometry(&x, &weight, stride);
        tensor(
            convolution::forward(&g, values(&x), values(&weight)),
            &[g.batch, g.out_height(), g.out_width(), g.out_channels],
        )
    }

    fn norm_relu_rows(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: FloatTensor<Self>,
        arguments: NormArguments,
    ) -> FloatTensor<Self> {
        let (x, gamma, beta) = (contiguous(&x), contiguous(&gamma), contiguous(&beta));
        let shape = [x.layout().shape()[0], x.layout().shape()[1]];
        let (y, moments) = normalisation::forward(
            values(&x),
            shape[1],
            &arguments.groups,
            values(&gamma),
            values(&beta),
            arguments.eps,
        );
        *arguments
            .found
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = moments;
        tensor(y, &shape)
    }
}

#[derive(Debug)]
struct ConvolutionBackward;

impl Backward<Flex, 2> for ConvolutionBackward {
    type State = (Cpu, Cpu, usize);

    fn backward(
        self,
        ops: Ops<Self::State, 2>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let [x_node, weight_node] = ops.parents;
        let grad = contiguous(&grads.consume::<Flex>(&ops.node));
        let (x, weight, stride) = ops.state;
        let g = geometry(&x, &weight, stride);
        if let Some(node) = x_node {
            let grad_x = convolution::grad_input(&g, values(&grad), values(&weight));
            grads.register::<Flex>(
                node.id,
                tensor(grad_x, &[g.batch, g.height, g.width, g.in_channels]),
            );
        }
        if let Some(node) = weight_node {
            let grad_weight = convolution::grad_weight(&g, values(&x), values(&grad));
            grads.register::<Flex>(
                node.id,
                tensor(grad_weight, &[g.out_channels, g.in_channels, 3, 3]),
            );
        }
    }
}

#[derive(Debug)]
struct NormReluBackward;

impl Backward<Flex, 3> for NormReluBackward {
    type State = (Cpu, Cpu, Cpu, NormArguments, Moments);

    fn backward(
        self,
        ops: Ops<Self::State, 3>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let grad = contiguous(&grads.consume::<Flex>(&ops.node));
        let (x, gamma, beta, arguments, moments) = ops.state;
        let channels = gamma.layout().shape()[1];
        let shape = [gamma.layout().shape()[0], channels];
        let (grad_x, grad_gamma, grad_beta) = normalisation::backward(
            values(&grad),
            values(&x),
            channels,
            &arguments.groups,
            values(&gamma),
            values(&beta),
            &moments,
            arguments.eps,
        );
        let rows = grad_x.len() / channels;
        let [x_node, gamma_node, beta_node] = ops.parents;
        if let Some(node) = x_node {
            grads.register::<Flex>(node.id, tensor(grad_x, &[rows, channels]));
        }
        if let Some(node) = gamma_node {
            grads.register::<Flex>(node.id, tensor(grad_gamma, &shape));
        }
        if let Some(node) = beta_node {
            grads.register::<Flex>(node.id, tensor(grad_beta, &shape));
        }
    }
}

impl<C: CheckpointStrategy> TrainingOps for Autodiff<Flex, C> {
    fn conv3x3_nhwc(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        stride: usize,
    ) -> FloatTensor<Self> {
        let nodes = [x.node(), weight.node()];
        let (x, weight) = (contiguous(x.primitive()), contiguous(weight.primitive()));
        let output = Flex::conv3x3_nhwc(x.clone(), weight.clone(), stride);
        match ConvolutionBackward
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => prep.finish((x, weight, stride), output),
            OpsKind::UnTracked(prep) => prep.finish(output),
        }
    }

    fn norm_relu_rows(
        x: FloatTensor<Self>,
        gamma: FloatTensor<Self>,
        beta: FloatTensor<Self>,
        arguments: NormArguments,
    ) -> FloatTensor<Self> {
        let nodes = [x.node(), gamma.node(), beta.node()];
        let (x, gamma, beta) = (
            contiguous(x.primitive()),
            contiguous(gamma.primitive()),
            contiguous(beta.primitive()),
        );
        let output =
            Flex::norm_relu_rows(x.clone(), gamma.clone(), beta.clone(), arguments.clone());
        let moments = arguments
            .found
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        match NormReluBackward
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => prep.finish((x, gamma, beta, arguments, moments), output),
            OpsKind::UnTracked(prep) => prep.finish(output),
        }
    }
}

fn is_cpu(device: &Device) -> bool {
    *device == Device::flex()
}

/// 3x3 convolution with padding 1 and no bias.
///
/// # Shapes
/// `x` `[n, h, w, c]`, `weight` `[o, c, 3, 3]` (OIHW, as in the model file), result `[n, h / stride, w / stride, o]`.
pub fn conv3x3(x: Tensor<4>, weight: Tensor<4>, stride: usize) -> Tensor<4> {
    if is_cpu(&x.device()) {
        return Tensor::from_dispatch(<Dispatch as TrainingOps>::conv3x3_nhwc(
            x.into_dispatch(),
            weight.into_dispatch(),
            stride,
        ));
    }
    composed_conv3x3(x, weight, stride)
}

/// 4x4 transposed convolution with stride 2, padding 1 and no bias (paper, eq. 4).
///
/// # Shapes
/// `x` `[n, h, w, c]`, `weight` `[c, o, 4, 4]`, result `[n, 2 h, 2 w, o]`.
pub fn transposed_conv4x4(x: Tensor<4>, weight: Tensor<4>) -> Tensor<4> {
    if is_cpu(&x.device()) {
        let options = ConvTransposeOptions::new([2, 2], [1, 1], [0, 0], [1, 1], 1);
        let y = conv_transpose2d(x.permute([0, 3, 1, 2]), weight, None, options);
        return y.permute([0, 2, 3, 1]);
    }
    composed_transposed_conv4x4(x, weight)
}

/// Normalises rows of channels by the statistics of their group, applies scale and shift of the group's domain, and ReLU.
///
/// # Shapes
/// `x` `[rows, c]`, `gamma` and `beta` `[domains, c]`; the groups' rows add up to `rows`. Returns the result, and mean and biased
/// variance of each group, `[groups, c]` each, without gradient.
pub fn norm_relu(
    x: Tensor<2>,
    gamma: Tensor<2>,
    beta: Tensor<2>,
    groups: &Arc<Vec<Group>>,
    eps: f32,
) -> (Tensor<2>, Tensor<2>, Tensor<2>) {
    let device = x.device();
    if !is_cpu(&device) {
        return composed_norm_relu(x, gamma, beta, groups, eps);
    }
    let channels = x.dims()[1];
    let found = Arc::new(Mutex::new(Moments::default()));
    let arguments = NormArguments {
        groups: groups.clone(),
        eps,
        found: found.clone(),
    };
    let y = Tensor::from_dispatch(<Dispatch as TrainingOps>::norm_relu_rows(
        x.into_dispatch(),
        gamma.into_dispatch(),
        beta.into_dispatch(),
        arguments,
    ));
    let moments = std::mem::take(&mut *found.lock().unwrap_or_else(PoisonError::into_inner));
    let device = device.without_autodiff();
    let shape = [groups.len(), channels];
    (
        y,
        Tensor::from_data(TensorData::new(moments.mean, shape), &device),
        Tensor::from_data(TensorData::new(moments.variance, shape), &device),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_numbers::uniform;
    use burn::tensor::TensorData;
    use std::cell::Cell;
    use std::ops::Range;

    fn close<const D: usize>(a: Tensor<D>, b: Tensor<D>, what: &str) {
        let a = a.into_data_as::<f32>().try_to_vec::<f32>().unwrap();
        let b = b.into_data_as::<f32>().try_to_vec::<f32>().unwrap();
        let scale = a.iter().fold(1.0f32, |m, v| m.max(v.abs()));
        for (x, y) in a.iter().zip(&b) {
            assert!((x - y).abs() < 2e-4 * scale, "{what}: {x} and {y}");
        }
    }

    #[test]
    fn custom_operations_agree_with_their_compositions_in_value_and_gradient() {
        let device = Device::flex().autodiff();
        let seed = Cell::new(0);
        let numbers = |shape: &[usize], range: Range<f32>| {
            seed.set(seed.get() + 1);
            let values = uniform(shape.iter().product(), range, seed.get());
            TensorData::new(values, shape.to_vec())
        };
        let random = |shape: [usize; 4]| {
            Tensor::<4>::from_data(numbers(&shape, -1.0..1.0), &device).require_grad()
        };
        type Convolution = fn(Tensor<4>, Tensor<4>) -> Tensor<4>;
        let convolutions: [(Convolution, Convolution, [usize; 4]); 3] = [
            (
                |x, w| conv3x3(x, w, 1),
                |x, w| composed_conv3x3(x, w, 1),
                [5, 4, 3, 3],
            ),
            (
                |x, w| conv3x3(x, w, 2),
                |x, w| composed_conv3x3(x, w, 2),
                [5, 4, 3, 3],
            ),
            (
                transposed_conv4x4,
                composed_transposed_conv4x4,
                [4, 5, 4, 4],
            ),
        ];
        for (ours, theirs, weight) in convolutions {
            let (x, w) = (random([3, 8, 6, 4]), random(weight));
            let (ours, theirs) = (ours(x.clone(), w.clone()), theirs(x.clone(), w.clone()));
            close(ours.clone(), theirs.clone(), "convolution");
            let pull = random(ours.dims());
            let (a, b) = (
                (ours * pull.clone()).sum().backward(),
                (theirs * pull).sum().backward(),
            );
            close(x.grad(&a).unwrap(), x.grad(&b).unwrap(), "input gradient");
            close(w.grad(&a).unwrap(), w.grad(&b).unwrap(), "weight gradient");
        }
        let matrix = |shape: [usize; 2]| {
            Tensor::<2>::from_data(numbers(&shape, -1.0..2.0), &device).require_grad()
        };
        let groups = Arc::new(vec![
            Group {
                rows: 3000,
                domain: 0,
            },
            Group {
                rows: 40,
                domain: 1,
            },
            Group {
                rows: 60,
                domain: 1,
            },
        ]);
        let (x, gamma, beta, pull) = (
            matrix([3100, 6]),
            matrix([2, 6]),
            matrix([2, 6]),
            matrix([3100, 6]),
        );
        let (ours, mean, variance) =
            norm_relu(x.clone(), gamma.clone(), beta.clone(), &groups, 1e-5);
        let (theirs, their_mean, their_variance) =
            composed_norm_relu(x.clone(), gamma.clone(), beta.clone(), &groups, 1e-5);
        close(ours.clone(), theirs.clone(), "normalisation");
        close(mean, their_mean, "mean");
        close(variance, their_variance, "variance");
        let (a, b) = (
            (ours * pull.clone()).sum().backward(),
            (theirs * pull).sum().backward(),
        );
        close(x.grad(&a).unwrap(), x.grad(&b).unwrap(), "x gradient");
        close(
            gamma.grad(&a).unwrap(),
            gamma.grad(&b).unwrap(),
            "gamma gradient",
        );
        close(
            beta.grad(&a).unwrap(),
            beta.grad(&b).unwrap(),
            "beta gradient",
        );
    }
}
