//! Running mean and variance of normalisations.

use burn::tensor::Tensor;

/// Weight of a batch's moments in the running moments (PyTorch's default).
const MOMENTUM: f32 = 0.1;

/// Updates running mean and variance by the mean and biased variance of a batch of `rows` rows; as in PyTorch, the running
/// variance uses the unbiased variance.
pub fn follow_moments(
    [old_mean, old_variance]: [Tensor<1>; 2],
    [mean, variance]: [Tensor<1>; 2],
    rows: usize,
) -> [Tensor<1>; 2] {
    let unbias = rows as f32 / rows.saturating_sub(1).max(1) as f32;
    let keep = |old: Tensor<1>, new: Tensor<1>, factor: f32| {
        old.mul_scalar(1.0 - MOMENTUM) + new.mul_scalar(MOMENTUM * factor)
    };
    [
        keep(old_mean, mean, 1.0),
        keep(old_variance, variance, unbias),
    ]
}
