//! What the network says about a picture.

/// A point that can be found again in another picture of the same place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// Column: an integer pixel index; the centre of the leftmost pixel is 0.
    pub x_px: f32,
    /// Row: an integer pixel index; the centre of the topmost pixel is 0.
    pub y_px: f32,
    /// Probability, 0 to 1.
    pub score: f32,
}

/// How keypoints are chosen from the heatmap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtractOptions {
    /// Least probability (paper: 0.015).
    pub threshold: f32,
    /// The strongest so many are kept (paper: 1024).
    pub max_keypoints: usize,
    /// A keypoint is the largest value among all pixels whose row and column differ by at most this.
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

/// Everything that localisation needs of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Strongest first.
    pub keypoints: Vec<Keypoint>,
    /// n x [`Features::descriptor_dim`], a row of unit length for each keypoint.
    pub descriptors: Vec<f32>,
    /// Length of a local descriptor.
    pub descriptor_dim: usize,
    /// The global descriptor, of unit length.
    pub global: Vec<f32>,
}
