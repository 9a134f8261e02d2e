//! Which losses are trained, and their weights.

use serde::{Deserialize, Serialize};

/// Weights of the losses in the total loss (paper, eq. 25 and table 1).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Keypoint cross-entropy (the paper's beta 1).
    pub keypoint: f32,
    /// Weight of cells without a keypoint in the keypoint cross-entropy.
    pub dustbin: f32,
    /// Local descriptors (beta 2).
    pub descriptor: f32,
    /// Global descriptors (alpha).
    pub global: f32,
    /// Homography reprojection (gamma); 0 disables it.
    pub homography: f32,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            keypoint: 1.0,
            dustbin: 0.3,
            descriptor: 1.0,
            global: 0.5,
            homography: 0.0,
        }
    }
}

/// Losses for local descriptors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DescriptorLoss {
    /// Dual softmax over the points of a pair.
    #[default]
    Contrast,
    /// The paper's hinge over all pairs of points (eq. 16-17).
    Hinge,
}

/// Losses for global descriptors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GlobalLoss {
    /// InfoNCE against the batch and the memory of past batches.
    #[default]
    Contrast,
    /// The paper's triplet with the hardest negatives of the batch (eq. 9).
    Triplet,
    /// Multi-similarity (Wang et al. 2019) within the batch.
    MultiSimilarity,
}
