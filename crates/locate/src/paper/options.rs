//! The settings of the paper.

use grimnet_pack::Mode;

use crate::{
    geometry::{estimation::GeometryModel, ransac::Ransac, sampler::Sampling},
    options::{Choice, Coordinates, Options},
};

impl Options {
    /// The settings of the paper: the whole photo at the network's resolution, top 5 by descriptor, ratio test at 0.8, RANSAC-DLT
    /// with 4 px and 1000 iterations, weighted refinement, the largest inliers / (matches + 1), always an answer.
    pub fn paper() -> Self {
        Self {
            mode: Mode::Paper,
            top_k: 5,
            index: None,
            map_vote: None,
            keypoint_threshold: 0.015,
            max_keypoints: 1024,
            vote: None,
            max_matched: 5,
            min_matched: 5,
            clear_inliers: usize::MAX,
            max_ratio: Some(0.8),
            ransac: Ransac::PAPER,
            sampling: Sampling::Uniform,
            geometry: GeometryModel::PlainHomography,
            choice: Choice::InlierRatio,
            gates: None,
            coordinates: Coordinates::PaperCorners,
            guided: false,
            realign: false,
            ..Self::default()
        }
    }
}
