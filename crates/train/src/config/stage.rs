//! The stages of training.

use serde::{Deserialize, Serialize};
use std::fmt;

/// What a run trains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Everything: keypoints, local and global descriptors, on pairs of views.
    #[default]
    Joint,
    /// The keypoint head, with the layers below it if it has some, on drawn shapes whose corners are known (MagicPoint;
    /// DeTone et al. 2018). Needs no pictures.
    Shapes,
    /// The encoder, by scene classification, on pictures in one folder for each class.
    Scenes,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Joint => "joint",
            Self::Shapes => "shapes",
            Self::Scenes => "scenes",
        })
    }
}
