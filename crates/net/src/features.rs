//! The features of an image.

/// A point that can be detected again in another image of the same place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// Column: an integer pixel index; the centre of the leftmost pixel is 0.
    pub x_px: f32,
    /// Row: an integer pixel index; the centre of the topmost pixel is 0.
    pub y_px: f32,
    /// Probability, 0 to 1.
    pub score: f32,
}

/// How keypoints are selected from the heatmap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtractOptions {
    /// Smallest probability (paper: 0.015).
    pub threshold: f32,
    /// Largest number of keypoints; the strongest are kept (paper: 1024).
    pub max_keypoints: usize,
    /// Radius of the non-maximum suppression: a keypoint is the largest value among all pixels whose row and column differ
    /// by at most this.
    pub nms_radius_px: u32,
}

impl Default for ExtractOptions {
    fn default() -> Self {
        Self {
            threshold: 0.015,
            max_keypoints: 1024,
            nms_radius_px: 2,
        }
    }
}

/// Keypoints, local descriptors and global descriptor of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Strongest first.
    pub keypoints: Vec<Keypoint>,
    /// n x [`Features::descriptor_dim`] values: a row of unit length for each keypoint.
    pub descriptors: Vec<f32>,
    /// Length of a local descriptor.
    pub descriptor_dim: usize,
    /// The global descriptor, of unit length.
    pub global: Vec<f32>,
}
