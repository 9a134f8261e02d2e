//! The features of a photo that was localised, kept to measure the motion to another photo without a second pass of the network.

use nalgebra::{Matrix3, Point2, Vector2};

use crate::{
    pipeline::verification::VerifiedCandidate, query_features::QueryFeatures,
    search::matching::Descriptors,
};

/// Keypoints and descriptors of one photo, made by [`crate::Localizer::locate_with_features`].
#[derive(Debug, Clone)]
pub struct FrameFeatures {
    /// Keypoints, strongest first, pixels of the full-size photo relative to its centre: x to the right, y down.
    pub(crate) points_px: Vec<Point2<f64>>,
    /// Probabilities of the keypoints.
    pub(crate) scores: Vec<f32>,
    /// Whether the keypoint agreed with the fix on the map: it then lies on the ground, or near it.
    pub(crate) on_map: Vec<bool>,
    /// Whether the fix is trusted.
    fix_is_trusted: bool,
    /// Whether the keypoint moved with the ground of the photo before.
    pub(crate) followed: Vec<bool>,
    query: QueryFeatures,
    /// Pixels of the full-size photo per pixel of the query, at the photo's centre.
    pub(crate) photo_px_per_query_px: f64,
}

impl FrameFeatures {
    /// The features of a query, with `verified` as the fix that they gave. `full_px_per_image_px` is the ratio of the photo's full
    /// size to that of its pixels in memory, `image_centre_px` the centre of the latter.
    pub(crate) fn new(
        query: &QueryFeatures,
        verified: Option<&VerifiedCandidate>,
        image_centre_px: Point2<f64>,
        full_px_per_image_px: f64,
    ) -> Self {
        let to_photo = &query.photo_px_from_query_px;
        let mut on_map = vec![false; query.points.len()];
        if let Some(verified) = verified {
            let agreeing = verified.inliers.iter().map(|&index| verified.pairs[index]);
            let mut agreeing: Vec<Point2<f64>> = agreeing.map(|pair| pair.from).collect();
            agreeing.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
            for (flag, point) in on_map.iter_mut().zip(&query.points) {
                let point = point.cast::<f64>();
                *flag = agreeing
                    .binary_search_by(|a| a.x.total_cmp(&point.x).then(a.y.total_cmp(&point.y)))
                    .is_ok();
            }
        }
        let centred = |point: &Point2<f32>| {
            let homogeneous = to_photo * point.cast::<f64>().to_homogeneous();
            let photo_px = Point2::from_homogeneous(homogeneous).unwrap_or(image_centre_px);
            Point2::from((photo_px - image_centre_px) * full_px_per_image_px)
        };
        Self {
            points_px: query.points.iter().map(centred).collect(),
            scores: query.scores.clone(),
            followed: vec![false; on_map.len()],
            on_map,
            fix_is_trusted: true,
            photo_px_per_query_px: scale_at(to_photo, query) * full_px_per_image_px,
            query: query.clone(),
        }
    }

    /// Number of keypoints.
    pub fn len(&self) -> usize {
        self.points_px.len()
    }

    /// Whether there is no keypoint.
    pub fn is_empty(&self) -> bool {
        self.points_px.is_empty()
    }

    /// The fix turned out to be of another place: that keypoints agreed with the map there does not make them ground.
    pub fn distrust_fix(&mut self) {
        self.fix_is_trusted = false;
    }

    /// Whether a keypoint lies on ground that the map shows.
    pub(crate) fn is_on_map(&self, keypoint: usize) -> bool {
        self.fix_is_trusted && self.on_map[keypoint]
    }

    /// Whether a keypoint lies on ground that the map shows, or moved with such ground.
    pub(crate) fn is_ground(&self, keypoint: usize) -> bool {
        self.is_on_map(keypoint) || self.followed[keypoint]
    }

    /// Dimension of a descriptor.
    pub(crate) fn dim(&self) -> usize {
        self.query.dim
    }

    /// Half the square root of the photo's visible area, pixels of the full-size photo.
    pub(crate) fn half_side_px(&self) -> f64 {
        self.query.half_side_px * self.photo_px_per_query_px
    }

    /// The descriptors of all keypoints.
    pub(crate) fn descriptors(&self) -> Descriptors<'_> {
        self.query.strongest(usize::MAX)
    }
}

/// Pixels of the photo in memory per query pixel at the query's centre.
pub(crate) fn scale_at(photo_px_from_query_px: &Matrix3<f64>, query: &QueryFeatures) -> f64 {
    let m = photo_px_from_query_px;
    let centre = Point2::from(query.centre_px);
    let mapped = m * centre.to_homogeneous();
    // Columns of the derivative of the mapped point by the query's x and y.
    let column = |axis: usize| {
        Vector2::new(
            m[(0, axis)] * mapped.z - mapped.x * m[(2, axis)],
            m[(1, axis)] * mapped.z - mapped.y * m[(2, axis)],
        ) / (mapped.z * mapped.z)
    };
    column(0).perp(&column(1)).abs().sqrt()
}
