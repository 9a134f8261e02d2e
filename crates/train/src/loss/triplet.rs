//! The paper's retrieval loss (eq. 9; Hermans et al. 2017) with its online hard mining (Shrivastava et al. 2016).

use super::{DISTANCE_EPSILON, MASKED, constant};
use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// Settings of [`triplet`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TripletOptions {
    /// Margin between the distances of negative and positive (paper: 0.5).
    pub margin: f32,
    /// Number m of most similar negatives of the batch that count for each query (not given in the paper).
    pub hardest: usize,
}

impl Default for TripletOptions {
    fn default() -> Self {
        Self {
            margin: 0.5,
            hardest: 4,
        }
    }
}

/// Mean over queries and their m most similar negatives of `max(d(q, pos) - d(q, neg) + margin, 0)`, with `d` the L2 distance.
///
/// # Shapes
/// `uav` (queries) and `sat` (the positive of each, row by row) `[n, d]`, unit rows; `excluded` `[n * n]` is true where a
/// column is not a negative of a row; the diagonal never is. A scalar, 0 if there are no negatives.
pub fn triplet(
    sat: Tensor<2>,
    uav: Tensor<2>,
    excluded: &[bool],
    options: &TripletOptions,
) -> Tensor<1> {
    let [n, _] = sat.dims();
    let device = sat.device();
    let barred = |i: usize| i / n == i % n || excluded[i];
    let hardest = options.hardest.clamp(1, n);
    // A row with fewer than `hardest` negatives counts with those it has.
    let available = |row: usize| (0..n).filter(|column| !barred(row * n + column)).count();
    let counts: Vec<usize> = (0..n).map(|row| available(row).min(hardest)).collect();
    let total = counts.iter().sum::<usize>().max(1) as f32;
    let valid = (0..n * hardest)
        .map(|i| {
            if i % hardest < counts[i / hardest] {
                1.0 / total
            } else {
                0.0
            }
        })
        .collect();
    let lowered = (0..n * n)
        .map(|i| if barred(i) { MASKED } else { 0.0 })
        .collect();

    let similarity = uav.matmul(sat.transpose());
    let (_, order) = (similarity.clone().detach() + constant(lowered, [n, n], &device))
        .sort_descending_with_indices(1);
    let order = order.narrow(1, 0, hardest);
    let own = Tensor::<2>::eye(n, &device);
    let positive = distance((similarity.clone() * own).sum_dim(1));
    let negative = distance(similarity.gather(1, order));
    let short = (positive - negative)
        .add_scalar(options.margin)
        .clamp_min(0.0);
    (short * constant(valid, [n, hardest], &device)).sum()
}

/// L2 distance of unit vectors, computed from their cosine.
fn distance(cosine: Tensor<2>) -> Tensor<2> {
    cosine
        .mul_scalar(-2.0)
        .add_scalar(2.0)
        .clamp_min(0.0)
        .add_scalar(DISTANCE_EPSILON)
        .sqrt()
}
