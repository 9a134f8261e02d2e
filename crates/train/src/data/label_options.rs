//! The settings of homographic adaptation.

use super::homography::HomographyRange;
use super::photometric::Look;
use serde::{Deserialize, Deserializer, Serialize};
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
    #[serde(deserialize_with = "homography_of_labels")]
    pub homography: HomographyRange,
    /// Range of the photometric changes; without `mixed`, which needs another picture.
    pub look: Look,
    /// Seed of the views.
    pub seed: u64,
}

/// The range of homographies of labels, wider than that of pairs.
const HOMOGRAPHY: HomographyRange = HomographyRange {
    rotation_deg: 180.0,
    log_scale: 0.4,
    log_stretch: 0.1,
    shift: 0.2,
    corner: 0.08,
};

/// A table in which missing keys have the values of [`HOMOGRAPHY`], not those of pairs.
fn homography_of_labels<'de, D: Deserializer<'de>>(table: D) -> Result<HomographyRange, D::Error> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Given {
        rotation_deg: Option<f64>,
        log_scale: Option<f64>,
        log_stretch: Option<f64>,
        shift: Option<f64>,
        corner: Option<f64>,
    }
    let given = Given::deserialize(table)?;
    Ok(HomographyRange {
        rotation_deg: given.rotation_deg.unwrap_or(HOMOGRAPHY.rotation_deg),
        log_scale: given.log_scale.unwrap_or(HOMOGRAPHY.log_scale),
        log_stretch: given.log_stretch.unwrap_or(HOMOGRAPHY.log_stretch),
        shift: given.shift.unwrap_or(HOMOGRAPHY.shift),
        corner: given.corner.unwrap_or(HOMOGRAPHY.corner),
    })
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
            homography: HOMOGRAPHY,
            look: Look::default(),
            seed: 1,
        }
    }
}
