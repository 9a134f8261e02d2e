//! The losses, on burn tensors. Values and gradients are tested against PyTorch.

mod contrast;
mod distillation;
mod hinge;
mod homography;
mod keypoint;
mod multi_similarity;
mod scene;
mod triplet;

pub use contrast::{descriptor_contrast, global_contrast, sample_descriptors};
pub use distillation::{descriptor_distillation, keypoint_distillation, similarity_distillation};
pub use hinge::{HingeOptions, descriptor_hinge};
pub use homography::{
    Correspondences, HomographyOptions, homography_reprojection, project, solve_positive_definite,
    weighted_dlt,
};
pub use keypoint::keypoint_cross_entropy;
pub use multi_similarity::{MultiSimilarityOptions, multi_similarity};
pub use scene::scene_cross_entropy;
pub use triplet::{TripletOptions, triplet};

use burn::tensor::{Device, Tensor, TensorData};

/// Added to masked similarities.
pub(crate) const MASKED: f32 = -1e4;

/// Added under the root of a squared distance, whose derivative is infinite at 0.
const DISTANCE_EPSILON: f32 = 1e-8;

/// A constant tensor; part of the autodiff graph if the device has autodiff.
pub(crate) fn constant<const D: usize>(
    values: Vec<f32>,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}
