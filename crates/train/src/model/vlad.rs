//! NetVLAD.

use crate::error::TrainError;
use crate::model::parameters::Parameters;
use burn::tensor::Tensor;
use burn::tensor::activation::softmax;

/// Added to squared lengths before vectors are scaled to unit length.
const LENGTH_EPSILON: f32 = 1e-12;

/// NetVLAD (paper, eq. 5-7) with intra-normalisation and L2 normalisation. Cells outside the picture do not count.
///
/// # Shapes
/// `x` `[n, h, w, d]`, `seen` `[n, h * w, 1]`, result `[n, k * d]`.
///
/// # Errors
/// Returns an error if the parameters do not fit their description.
pub(super) fn net_vlad(
    parameters: &Parameters,
    x: Tensor<4>,
    seen: Tensor<3>,
) -> Result<Tensor<2>, TrainError> {
    let [n, h, w, d] = x.dims();
    let rows = x.reshape([n * h * w, d]);
    let vectors = if parameters.spec().vlad.input.is_scaled() {
        unit_rows(rows)
    } else {
        rows
    };
    let weight = parameters.shaped::<2>("netvlad.assign.weight")?;
    let bias = parameters.flat("netvlad.assign.bias")?;
    let centres = parameters.shaped::<2>("netvlad.centres")?;
    let k = weight.dims()[0];
    let logits = vectors.clone().matmul(weight.transpose()) + bias.unsqueeze::<2>();
    let share = softmax(logits, 1).reshape([n, h * w, k]) * seen;
    let sums = share
        .clone()
        .swap_dims(1, 2)
        .matmul(vectors.reshape([n, h * w, d]));
    let mass = share.sum_dim(1).swap_dims(1, 2);
    let residuals = sums - mass * centres.unsqueeze::<3>();
    let rows = unit_rows(residuals.reshape([n * k, d])).reshape([n, k * d]);
    Ok(unit_rows(rows))
}

/// Scales each row to unit length.
pub(crate) fn unit_rows(x: Tensor<2>) -> Tensor<2> {
    let length = x
        .clone()
        .square()
        .sum_dim(1)
        .add_scalar(LENGTH_EPSILON)
        .sqrt();
    x / length
}
