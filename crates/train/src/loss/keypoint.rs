//! Keypoint cross-entropy over the 65 classes of a cell (paper, eq. 13; DeTone et al. 2018).

use super::constant;
use burn::tensor::activation::log_softmax;
use burn::tensor::{Int, Tensor, TensorData};

/// Weighted mean of the cross-entropy: `sum w * -log p[label] / sum w`.
///
/// # Shapes
/// `logits` `[cells, 65]`; `labels` and `weights` of `cells` values (label 64 is "no keypoint"; weight 0 ignores a cell). A scalar.
pub fn keypoint_cross_entropy(logits: Tensor<2>, labels: &[u8], weights: &[f32]) -> Tensor<1> {
    let device = logits.device();
    let [cells, _] = logits.dims();
    let total: f32 = weights.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    let labels: Vec<i32> = labels.iter().map(|label| i32::from(*label)).collect();
    let labels = Tensor::<2, Int>::from_data(TensorData::new(labels, [cells, 1]), &device);
    let weights = constant(
        weights.iter().map(|w| -w / total).collect(),
        [cells, 1],
        &device,
    );
    (log_softmax(logits, 1).gather(1, labels) * weights).sum()
}
