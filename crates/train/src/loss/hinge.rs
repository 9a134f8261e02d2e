//! The paper's descriptor loss (eq. 16-17; DeTone et al. 2018): a hinge over all pairs of positions of the two views.

use super::constant;
use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// Settings of [`descriptor_hinge`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HingeOptions {
    /// Similarity above which corresponding descriptors have no loss (paper: 0.9).
    pub positive_margin: f32,
    /// Similarity below which other descriptors have no loss (paper: 0.2).
    pub negative_margin: f32,
    /// Weight of corresponding pairs (paper: 1; SuperPoint: 250).
    pub positive_weight: f32,
}

impl Default for HingeOptions {
    fn default() -> Self {
        Self {
            positive_margin: 0.9,
            negative_margin: 0.2,
            positive_weight: 1.0,
        }
    }
}

/// Mean over all pairs of points (i of one view, j of the other) of
/// `s w max(0, m_p - a_i b_j) + (1 - s) max(0, a_i b_j - m_n)`, where `s` is 1 if they are the same place.
///
/// # Shapes
/// `a` and `b` `[pairs * n, d]`, unit rows; `same` `[pairs * n * n]`: whether point i of the first view of a pair is point j
/// of the second. A scalar.
pub fn descriptor_hinge(
    a: Tensor<2>,
    b: Tensor<2>,
    pairs: usize,
    same: &[bool],
    options: &HingeOptions,
) -> Tensor<1> {
    let [rows, d] = a.dims();
    let n = rows / pairs;
    let device = a.device();
    let (a, b) = (a.reshape([pairs, n, d]), b.reshape([pairs, n, d]));
    let similarity = a.matmul(b.swap_dims(1, 2));
    let mask = |of: bool, weight: f32| {
        let values = same.iter().map(|s| if *s == of { weight } else { 0.0 });
        constant(values.collect(), [pairs, n, n], &device)
    };
    let pull = similarity
        .clone()
        .neg()
        .add_scalar(options.positive_margin)
        .clamp_min(0.0);
    let push = similarity
        .sub_scalar(options.negative_margin)
        .clamp_min(0.0);
    (pull * mask(true, options.positive_weight) + push * mask(false, 1.0)).mean()
}
