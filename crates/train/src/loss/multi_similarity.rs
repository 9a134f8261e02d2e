//! Multi-similarity loss for retrieval (Wang et al. 2019, eq. 9-11).

use super::constant;
use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// Settings of [`multi_similarity`]; the defaults are those of its paper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MultiSimilarityOptions {
    /// Scale of positive similarities.
    pub alpha: f32,
    /// Scale of negative similarities.
    pub beta: f32,
    /// Similarity threshold between positives and negatives.
    pub threshold: f32,
    /// Mining margin: a negative counts if it is at most this much less similar than the positive, and a positive if it is at
    /// most this much more similar than the most similar negative.
    pub mining_margin: f32,
}

impl Default for MultiSimilarityOptions {
    fn default() -> Self {
        Self {
            alpha: 2.0,
            beta: 50.0,
            threshold: 0.5,
            mining_margin: 0.1,
        }
    }
}

/// Mean over queries of `log(1 + e^(-alpha (s_pos - t))) / alpha + log(1 + sum e^(beta (s_neg - t))) / beta`, over the mined
/// pairs.
///
/// # Shapes
/// As [`super::triplet`]: `sat`, `uav` `[n, d]`, unit rows; `excluded` `[n * n]`. A scalar.
pub fn multi_similarity(
    sat: Tensor<2>,
    uav: Tensor<2>,
    excluded: &[bool],
    options: &MultiSimilarityOptions,
) -> Tensor<1> {
    let [n, _] = sat.dims();
    let device = sat.device();
    let allowed = (0..n * n)
        .map(|i| f32::from(u8::from(i / n != i % n && !excluded[i])))
        .collect();
    let allowed = constant(allowed, [n, n], &device);
    let similarity = uav.matmul(sat.transpose());
    let positive = (similarity.clone() * Tensor::<2>::eye(n, &device)).sum_dim(1);

    let margin = options.mining_margin;
    let rivals = similarity.clone().detach();
    let own = positive.clone().detach();
    let hard = (rivals.clone().add_scalar(margin) - own.clone())
        .greater_elem(0.0)
        .float()
        * allowed.clone();
    // Similarities of unit vectors are at least -1, so that masked values are never the largest.
    let nearest = (rivals * allowed.clone() + allowed.sub_scalar(1.0).mul_scalar(2.0)).max_dim(1);
    let kept = (nearest.add_scalar(margin) - own).greater_elem(0.0).float();

    let exponent =
        |s: Tensor<2>, steepness: f32| s.sub_scalar(options.threshold).mul_scalar(steepness).exp();
    let pull = (exponent(positive, -options.alpha) * kept)
        .log1p()
        .div_scalar(options.alpha);
    let push = (exponent(similarity, options.beta) * hard)
        .sum_dim(1)
        .log1p()
        .div_scalar(options.beta);
    (pull + push).mean()
}
