//! SIFT, after Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 60 (2004): the classical baseline.
//!
//! Where the publication leaves a choice it is made as OpenCV's `cv::SIFT` makes it (number of octaves, borders, thresholds), with
//! `enable_precise_upscale`, so that results can be compared; a golden test holds keypoints, descriptors and matches beside it.

mod descriptor;
mod extrema;
mod orientation;
mod plane;
mod scale_space;

use image::GrayImage;

pub use descriptor::DESCRIPTOR_DIM;
use descriptor::{Place, describe};
use extrema::extrema;
use orientation::orientations_deg;
use plane::Plane;
use scale_space::octaves;

/// How keypoints are found. The defaults are Lowe's, with OpenCV's contrast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiftOptions {
    /// Scales an octave at which extrema are looked for.
    pub intervals: usize,
    /// Least contrast of a keypoint, as a share of white, times `intervals`.
    pub contrast: f32,
    /// Largest ratio of the principal curvatures: beyond it a point lies along an edge.
    pub edge_ratio: f32,
    /// Blur of each octave's first picture, pixels of the octave.
    pub sigma_px: f32,
    /// Keypoints at most, those of the highest contrast.
    pub most: usize,
}

impl Default for SiftOptions {
    fn default() -> Self {
        Self {
            intervals: 3,
            contrast: 0.04,
            edge_ratio: 10.0,
            sigma_px: 1.6,
            most: usize::MAX,
        }
    }
}

/// A keypoint in one of its orientations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiftKeypoint {
    /// Column; the centre of the first pixel is 0.
    pub x_px: f32,
    /// Row; the centre of the first pixel is 0.
    pub y_px: f32,
    /// Blur at which it was found, pixels of the picture: its scale.
    pub sigma_px: f32,
    /// Direction of its strongest gradients, degrees counter-clockwise from the picture's right.
    pub orientation_deg: f32,
    /// Its contrast, as a share of white.
    pub contrast: f32,
}

/// Keypoints of a picture, of the highest contrast first, with their descriptors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SiftFeatures {
    /// The keypoints.
    pub keypoints: Vec<SiftKeypoint>,
    /// Unit vectors, n x [`DESCRIPTOR_DIM`].
    pub descriptors: Vec<f32>,
}

/// Finds and describes the keypoints of a grey picture.
pub fn sift(picture: &GrayImage, options: &SiftOptions) -> SiftFeatures {
    let octaves = octaves(&Plane::of(picture), options);
    let mut found: Vec<(SiftKeypoint, usize, Place, usize)> = Vec::new();
    for (index, octave) in octaves.iter().enumerate() {
        for extremum in extrema(octave, options) {
            for orientation_deg in orientations_deg(&octave.gaussians[extremum.layer], &extremum) {
                let place = Place {
                    x_px: extremum.x_px,
                    y_px: extremum.y_px,
                    sigma_px: extremum.sigma_px,
                    orientation_deg,
                };
                let keypoint = SiftKeypoint {
                    x_px: extremum.x_px * octave.px,
                    y_px: extremum.y_px * octave.px,
                    sigma_px: extremum.sigma_px * octave.px,
                    orientation_deg,
                    contrast: extremum.contrast,
                };
                found.push((keypoint, index, place, extremum.layer));
            }
        }
    }
    // Stable, so that equals keep the order of octave, layer, row and column.
    found.sort_by(|a, b| b.0.contrast.total_cmp(&a.0.contrast));
    // Two samples may have moved to one extremum.
    found.dedup_by(|a, b| a.0 == b.0);
    found.truncate(options.most);
    let descriptors = found
        .iter()
        .flat_map(|(_, octave, place, layer)| describe(&octaves[*octave].gaussians[*layer], place))
        .collect();
    SiftFeatures {
        keypoints: found.into_iter().map(|f| f.0).collect(),
        descriptors,
    }
}
