//! The operations composed of burn's, for devices other than the CPU.

use super::normalisation::Group;
use burn::tensor::Tensor;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;

/// As [`super::conv3x3`].
pub(super) fn composed_conv3x3(x: Tensor<4>, weight: Tensor<4>, stride: usize) -> Tensor<4> {
    let y = conv2d(
        x.permute([0, 3, 1, 2]),
        weight,
        None,
        ConvOptions::new([stride; 2], [1; 2], [1; 2], 1),
    );
    y.permute([0, 2, 3, 1])
}

/// As [`super::norm_relu`].
pub(super) fn composed_norm_relu(
    x: Tensor<2>,
    gamma: Tensor<2>,
    beta: Tensor<2>,
    groups: &[Group],
    eps: f32,
) -> (Tensor<2>, Tensor<2>, Tensor<2>) {
    let (mut out, mut means, mut variances) = (Vec::new(), Vec::new(), Vec::new());
    let mut start = 0;
    for group in groups {
        let part = x.clone().narrow(0, start, group.rows);
        start += group.rows;
        let mean = part.clone().mean_dim(0);
        let centred = part - mean.clone();
        let variance = centred.clone().square().mean_dim(0);
        let gamma = gamma.clone().narrow(0, group.domain, 1);
        let beta = beta.clone().narrow(0, group.domain, 1);
        let y = centred / variance.clone().add_scalar(eps).sqrt() * gamma + beta;
        out.push(y.clamp_min(0.0));
        means.push(mean.without_autodiff());
        variances.push(variance.without_autodiff());
    }
    (
        Tensor::cat(out, 0),
        Tensor::cat(means, 0),
        Tensor::cat(variances, 0),
    )
}
