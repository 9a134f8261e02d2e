//! The paper's refinement: the transform of least reprojection error, each pair weighted by its keypoint's probability P
//! (eq. 19, "H* = argmin sum P ||pi(H C) - C'||^2"), by Levenberg-Marquardt in normalised coordinates.

use nalgebra::{SMatrix, SVector};

use crate::geometry::{
    correspondence::{Correspondence, Normalisation},
    transform::Transform,
};

/// A refined transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined<T> {
    /// The transform.
    pub model: T,
    /// Weighted sum of squared errors, square pixels.
    pub weighted_squares_px2: f64,
    /// Number of iterations.
    pub iterations: usize,
}

const MAX_ITERATIONS: usize = 50;
/// Relative decrease of the error below which the iteration has converged.
const CONVERGED: f64 = 1e-14;
const FIRST_DAMPING: f64 = 1e-6;
const LAST_DAMPING: f64 = 1e12;

/// Minimises the weighted squared reprojection error over `pairs`, starting from `start`.
///
/// Returns `None` if the pairs do not determine the transform, or `start` cannot map one of them.
pub fn refine<const N: usize, T: Transform<N>>(
    start: &T,
    pairs: &[Correspondence],
) -> Option<Refined<T>> {
    if 2 * pairs.len() < N {
        return None;
    }
    let from = Normalisation::of(pairs.iter().map(|pair| pair.from))?;
    let to = Normalisation::of(pairs.iter().map(|pair| pair.to))?;
    let scaled: Vec<Correspondence> = pairs
        .iter()
        .map(|pair| Correspondence::weighted(from.apply(pair.from), to.apply(pair.to), pair.weight))
        .collect();
    let mut model = start.normalised(&from, &to)?;
    let mut cost = cost_of(&model, &scaled)?;
    let mut damping = FIRST_DAMPING;
    let mut iterations = 0;
    while iterations < MAX_ITERATIONS {
        iterations += 1;
        let (normal, gradient) = normal_equations(&model, &scaled)?;
        let mut lowered = false;
        while damping < LAST_DAMPING {
            let mut damped = normal;
            for i in 0..N {
                damped[(i, i)] *= 1.0 + damping;
            }
            let step = damped.cholesky().map(|factor| factor.solve(&gradient));
            let next = step.map(|step| model.with_parameters(&(model.parameters() - step)));
            let next_cost = next.and_then(|next| cost_of(&next, &scaled).map(|cost| (next, cost)));
            match next_cost {
                Some((next, next_cost)) if next_cost <= cost => {
                    lowered = cost - next_cost > CONVERGED * cost;
                    (model, cost) = (next, next_cost);
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
                _ => damping *= 10.0,
            }
        }
        if !lowered {
            break;
        }
    }
    let model = model.denormalised(&from, &to)?;
    Some(Refined {
        model,
        weighted_squares_px2: cost / to.scale.powi(2),
        iterations,
    })
}

fn cost_of<const N: usize, T: Transform<N>>(model: &T, pairs: &[Correspondence]) -> Option<f64> {
    let cost = pairs
        .iter()
        .map(|pair| pair.weight * model.squared_error(pair.from, pair.to))
        .sum::<f64>();
    cost.is_finite().then_some(cost)
}

/// `J^T W J` and `J^T W r`, with r the mapped point minus the matched one.
pub(crate) fn normal_equations<const N: usize, T: Transform<N>>(
    model: &T,
    pairs: &[Correspondence],
) -> Option<(SMatrix<f64, N, N>, SVector<f64, N>)> {
    let (mut normal, mut gradient) = (SMatrix::<f64, N, N>::zeros(), SVector::<f64, N>::zeros());
    for pair in pairs {
        let jacobian = model.parameter_jacobian(pair.from)?;
        let residual = model.map(pair.from)? - pair.to;
        normal += jacobian.transpose() * jacobian * pair.weight;
        gradient += jacobian.transpose() * residual * pair.weight;
    }
    Some((normal, gradient))
}
