//! The network's output for a query.

use grimnet_net::Dense;
use image::GrayImage;
use nalgebra::Point2;

/// The descriptor field of a query, and which of its pixels show the photo.
pub(crate) struct DenseQuery {
    /// The network's output.
    pub dense: Dense,
    /// 0 where a pixel shows nothing.
    pub mask: GrayImage,
}

impl std::fmt::Debug for DenseQuery {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DenseQuery").finish_non_exhaustive()
    }
}

impl DenseQuery {
    /// Whether the query shows the photo at `point`, continuous pixels.
    pub fn shows(&self, point: Point2<f64>) -> bool {
        let (width, height) = (self.dense.width_px(), self.dense.height_px());
        let inside = (0.0..f64::from(width)).contains(&point.x)
            && (0.0..f64::from(height)).contains(&point.y);
        inside && self.mask.get_pixel(point.x as u32, point.y as u32).0[0] > 0
    }
}
