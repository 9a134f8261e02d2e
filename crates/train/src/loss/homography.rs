//! The paper's homography loss (eq. 24): the reprojection error of a homography estimated from the descriptors, by a weighted DLT
//! on soft matches, so that the gradient reaches the descriptors.

use super::{DISTANCE_EPSILON, constant};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

/// Unknowns of a homography whose last element is 1.
const UNKNOWNS: usize = 8;
/// Regularisation of the perspective terms, per point: without correct matches they would be arbitrary.
const RIDGE: f32 = 1e-3;
/// Least denominator: points behind the horizon have no projection.
const LEAST_DENOMINATOR: f32 = 0.2;

/// Settings of [`homography_reprojection`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HomographyOptions {
    /// Temperature of the soft matches.
    pub temperature: f32,
    /// Unit of the error, pixels (paper: 1).
    pub unit_px: f32,
}

impl Default for HomographyOptions {
    fn default() -> Self {
        Self {
            temperature: 0.05,
            unit_px: 1.0,
        }
    }
}

/// Corresponding points of the pairs of a batch, `[pairs, n, 2]` each, pixels.
#[derive(Clone, Debug)]
pub struct Correspondences {
    /// Points of the first view.
    pub from_px: Tensor<3>,
    /// The corresponding points of the second view.
    pub to_px: Tensor<3>,
    /// Side of the views, pixels.
    pub side_px: f32,
}

/// Mean distance between the points mapped by the estimated homography and the true points, in units of `unit_px`.
///
/// The soft match of a point of the first view is the mean of the points of the second view, weighted by the softmax of the
/// descriptors' similarities. Its weight in the DLT is the square of the largest of these weights.
///
/// # Shapes
/// `a` and `b` `[pairs * n, d]`, unit rows, descriptors of the points of both views. A scalar.
pub fn homography_reprojection(
    a: Tensor<2>,
    b: Tensor<2>,
    points: &Correspondences,
    options: &HomographyOptions,
) -> Tensor<1> {
    let [pairs, n, _] = points.from_px.dims();
    let d = a.dims()[1];
    let half = points.side_px / 2.0;
    let centred = |at: &Tensor<3>| at.clone().sub_scalar(half).div_scalar(half);
    let (from, to) = (centred(&points.from_px), centred(&points.to_px));

    let (a, b) = (a.reshape([pairs, n, d]), b.reshape([pairs, n, d]));
    let similarity = a.matmul(b.swap_dims(1, 2));
    let share = softmax(similarity.div_scalar(options.temperature), 2);
    let matched = share.clone().matmul(to.clone());
    let weight = share.max_dim(2).square();

    let homography = weighted_dlt(from.clone(), matched, weight);
    let carried = project(homography, from);
    let off = (carried - to)
        .square()
        .sum_dim(2)
        .add_scalar(DISTANCE_EPSILON);
    off.sqrt().mean().mul_scalar(half / options.unit_px)
}

/// The homography, last element 1, that minimises the weighted algebraic error `w |(H p)_xy - (H p)_z q|^2`.
///
/// # Shapes
/// `from` and `to` `[b, n, 2]`, coordinates of the order of 1; `weight` `[b, n, 1]`, not negative; result `[b, 8, 1]`, H row
/// by row.
pub fn weighted_dlt(from: Tensor<3>, to: Tensor<3>, weight: Tensor<3>) -> Tensor<3> {
    let [b, n, _] = from.dims();
    let device = from.device();
    let axis = |points: &Tensor<3>, i: usize| points.clone().narrow(2, i, 1);
    let (x, y) = (axis(&from, 0), axis(&from, 1));
    let (u, v) = (axis(&to, 0), axis(&to, 1));
    let (zero, one) = (x.zeros_like(), x.ones_like());
    let row = |first: [Tensor<3>; 6], target: &Tensor<3>| {
        let [a, b, c, d, e, f] = first;
        let perspective = |axis: &Tensor<3>| (axis.clone() * target.clone()).neg();
        Tensor::cat(vec![a, b, c, d, e, f, perspective(&x), perspective(&y)], 2)
    };
    let along_x = [
        x.clone(),
        y.clone(),
        one.clone(),
        zero.clone(),
        zero.clone(),
        zero.clone(),
    ];
    let along_y = [zero.clone(), zero.clone(), zero, x.clone(), y.clone(), one];
    let design = Tensor::cat(vec![row(along_x, &u), row(along_y, &v)], 1);
    let target = Tensor::cat(vec![u, v], 1);
    let weight = Tensor::cat(vec![weight.clone(), weight], 1);

    // Weights are scaled to mean 1, so that the effect of the ridge does not depend on their scale.
    let scale = weight.clone().mean_dim(1).add_scalar(f32::MIN_POSITIVE);
    let weighted = (design.clone() * (weight / scale)).swap_dims(1, 2);
    let normal = weighted.clone().matmul(design) + ridge(b, n, &device);
    solve_positive_definite(normal, weighted.matmul(target))
}

/// Diagonal matrix: `RIDGE` for the perspective terms, a thousandth of it elsewhere against rounding errors.
fn ridge(batch: usize, points: usize, device: &Device) -> Tensor<3> {
    let mut values = vec![0.0; UNKNOWNS * UNKNOWNS];
    for i in 0..UNKNOWNS {
        let strength = if i < 6 { RIDGE * 1e-3 } else { RIDGE };
        values[i * UNKNOWNS + i] = strength * points as f32;
    }
    constant(values, [1, UNKNOWNS, UNKNOWNS], device).expand([batch, UNKNOWNS, UNKNOWNS])
}

/// Solves `m x = r` for a batch by Gauss-Jordan elimination on the device; symmetric positive definite matrices need no
/// pivoting.
///
/// # Shapes
/// `m` `[b, k, k]`, `r` `[b, k, 1]`, result `[b, k, 1]`.
pub fn solve_positive_definite(m: Tensor<3>, r: Tensor<3>) -> Tensor<3> {
    let [_, k, _] = m.dims();
    let device = m.device();
    let mut augmented = Tensor::cat(vec![m, r], 2);
    for i in 0..k {
        let row = augmented.clone().narrow(1, i, 1);
        let row = row.clone() / row.narrow(2, i, 1);
        // Eliminates column i from the other rows and divides row i by its pivot.
        let mut own = vec![0.0; k];
        own[i] = 1.0;
        let own = constant(own, [1, k, 1], &device);
        let factor = augmented.clone().narrow(2, i, 1) - own;
        augmented = augmented - factor.matmul(row);
    }
    augmented.narrow(2, k, 1)
}

/// Applies homographies `[b, 8, 1]` to points `[b, n, 2]`.
pub fn project(homography: Tensor<3>, points: Tensor<3>) -> Tensor<3> {
    let element = |i: usize| homography.clone().narrow(1, i, 1);
    let (x, y) = (points.clone().narrow(2, 0, 1), points.narrow(2, 1, 1));
    let line = |i: usize| x.clone() * element(i) + y.clone() * element(i + 1);
    let denominator = line(6).add_scalar(1.0).clamp_min(LEAST_DENOMINATOR);
    let axis = |i: usize| (line(i) + element(i + 2)) / denominator.clone();
    Tensor::cat(vec![axis(0), axis(3)], 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_numbers::uniform;

    fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
        tensor.try_into_vec_as::<f32>().unwrap()
    }

    #[test]
    fn a_known_homography_is_found_from_its_points() {
        let device = Device::flex();
        let truth = [1.1f32, 0.1, 0.05, -0.2, 0.9, -0.1, 0.03, -0.02];
        let h = Tensor::<3>::from_data(
            burn::tensor::TensorData::new(truth.to_vec(), [1, 8, 1]),
            &device,
        );
        let from = constant(uniform(80, -1.0..1.0, 1), [1, 40, 2], &device);
        let to = project(h, from.clone());
        let weight = Tensor::ones([1, 40, 1], &device);
        let found = project(weighted_dlt(from.clone(), to.clone(), weight), from);
        for (a, b) in host(found).into_iter().zip(host(to)) {
            assert!((a - b).abs() < 2e-3, "{a} and {b}");
        }
    }

    #[test]
    fn a_point_of_no_weight_does_not_count() {
        let device = Device::flex();
        let from = constant(uniform(80, -1.0..1.0, 2), [2, 20, 2], &device);
        let off = Tensor::cat(
            vec![
                Tensor::ones([2, 1, 2], &device),
                Tensor::zeros([2, 19, 2], &device),
            ],
            1,
        );
        let weight = Tensor::cat(
            vec![
                Tensor::zeros([2, 1, 1], &device),
                Tensor::ones([2, 19, 1], &device),
            ],
            1,
        );
        let found = weighted_dlt(from.clone(), from.clone() + off, weight);
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        for (i, value) in host(found).into_iter().enumerate() {
            assert!((value - identity[i % 8]).abs() < 1e-3, "{value} at {i}");
        }
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let plain = Device::flex();
        let device = plain.clone().autodiff();
        let (pairs, n, d) = (2usize, 12usize, 6usize);
        // With these seeds no two weights are nearly equal; there the loss is not differentiable.
        let descriptors = |seed| uniform(pairs * n * d, -1.0..1.0, seed);
        let (a, b) = (descriptors(3), descriptors(4));
        let places = |seed: f32| -> Vec<f32> {
            (0..pairs * n * 2)
                .map(|i| 8.0 + 100.0 * ((i as f32 * 0.731 + seed).sin().abs()))
                .collect()
        };
        let from = places(0.3);
        let to: Vec<f32> = from.iter().map(|v| 0.9 * v + 4.0).collect();
        let options = HomographyOptions {
            temperature: 0.5,
            unit_px: 10.0,
        };
        let loss = |a: Tensor<2>, b: Tensor<2>, device: &Device| {
            let points = Correspondences {
                from_px: constant(from.clone(), [pairs, n, 2], device),
                to_px: constant(to.clone(), [pairs, n, 2], device),
                side_px: 128.0,
            };
            homography_reprojection(a, b, &points, &options)
        };
        let tracked = |v: &[f32]| constant(v.to_vec(), [pairs * n, d], &device).require_grad();
        let (ta, tb) = (tracked(&a), tracked(&b));
        let gradients = loss(ta.clone(), tb.clone(), &device).backward();
        let slope = |a: &[f32], b: &[f32]| {
            let at = |v: &[f32]| constant(v.to_vec(), [pairs * n, d], &plain);
            host(loss(at(a), at(b), &plain))[0]
        };
        let step = 4e-3;
        for (i, gradient) in host(ta.grad(&gradients).unwrap())
            .into_iter()
            .enumerate()
            .step_by(7)
        {
            let (mut up, mut down) = (a.clone(), a.clone());
            up[i] += step;
            down[i] -= step;
            let numeric = (slope(&up, &b) - slope(&down, &b)) / (2.0 * step);
            assert!(
                (numeric - gradient).abs() < 2e-2 * numeric.abs().max(0.05),
                "{numeric} and {gradient}"
            );
        }
        assert!(
            host(tb.grad(&gradients).unwrap())
                .iter()
                .any(|g| g.abs() > 1e-3)
        );
    }
}
