//! The settings of homographic adaptation.

use super::homography::HomographyRange;
use super::photometric::Look;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// How keypoint labels are made and where they are stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LabelOptions {
    /// Folder of the labels. It may contain labels by other detectors and settings.
    pub folder: PathBuf,
    /// The detector: a model file or a checkpoint of another run; the bundled model if absent.
    pub detector: Option<PathBuf>,
    /// Number of views of each window, including the unchanged one.
    pub views: usize,
    /// Side of a view, pixels; a multiple of 32. Larger pictures are divided into windows.
    pub side_px: u32,
    /// Least mean probability of a keypoint.
    pub threshold: f32,
    /// Radius of non-maximum suppression along both axes, pixels.
    pub nms_radius_px: usize,
    /// Range of the homographies.
    pub homography: HomographyRange,
    /// Range of the photometric changes.
    pub look: Look,
    /// Seed of the views.
    pub seed: u64,
}

impl Default for LabelOptions {
    fn default() -> Self {
        Self {
            folder: "labels".into(),
            detector: None,
            views: 48,
            side_px: 416,
            threshold: 0.015,
            nms_radius_px: 4,
            homography: HomographyRange {
                rotation_deg: 180.0,
                log_scale: 0.4,
                log_stretch: 0.1,
                shift: 0.2,
                corner: 0.08,
            },
            look: Look::default(),
            seed: 1,
        }
    }
}
