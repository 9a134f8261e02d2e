//! Distillation losses: the outputs of a teacher network are the targets (Hinton et al. 2015; similarities as in Tung and Mori
//! 2019).

use super::constant;
use crate::model::vlad::unit_rows;
use burn::tensor::Tensor;
use burn::tensor::activation::log_softmax;

/// Weighted mean of the cross-entropy between the teacher's and the student's probabilities: `sum w * -sum_c p_c log q_c / sum w`.
///
/// # Shapes
/// `logits` and `teacher` (probabilities) `[cells, 65]`, `weights` of `cells` values (0 ignores a cell). A scalar.
pub fn keypoint_distillation(logits: Tensor<2>, teacher: Tensor<2>, weights: &[f32]) -> Tensor<1> {
    let cross = (log_softmax(logits, 1) * teacher).sum_dim(1);
    weighted_mean(cross, weights).neg()
}

/// One minus the cosine between the student's and the teacher's descriptors. Shorter rows of the teacher are padded with zeros,
/// so that the student learns the same similarities.
///
/// # Shapes
/// `student` `[cells, d]`, any length; `teacher` `[cells, t]` with `t <= d`, unit rows; `weights` of `cells` values. A scalar.
pub fn descriptor_distillation(
    student: Tensor<2>,
    teacher: Tensor<2>,
    weights: &[f32],
) -> Tensor<1> {
    let [_, t] = teacher.dims();
    let cosine = (unit_rows(student).narrow(1, 0, t) * teacher).sum_dim(1);
    weighted_mean(cosine, weights).neg().add_scalar(1.0)
}

/// Mean squared difference between the student's and the teacher's similarity matrices of a batch; the descriptors may have
/// different lengths.
///
/// # Shapes
/// `student` `[n, d]`, `teacher` `[n, t]`, unit rows. A scalar.
pub fn similarity_distillation(student: Tensor<2>, teacher: Tensor<2>) -> Tensor<1> {
    let within = |rows: Tensor<2>| rows.clone().matmul(rows.transpose());
    (within(student) - within(teacher)).square().mean()
}

/// `[cells, 1]` to a scalar.
fn weighted_mean(values: Tensor<2>, weights: &[f32]) -> Tensor<1> {
    let total: f32 = weights.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    let device = values.device();
    let share = weights.iter().map(|w| w / total).collect();
    (values * constant(share, [weights.len(), 1], &device)).sum()
}
