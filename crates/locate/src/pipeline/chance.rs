//! How many of a transform's inliers chance would give: the background model of an a-contrario test (Moisan and Stival 2004;
//! Moulon, Monasse and Marlet 2012, AC-RANSAC).
//!
//! Guided matching gathers matches along the very transform that it supports, so their number alone is no evidence. Counted here
//! is the number of guided matches that the same search would keep if descriptors said nothing.

use nalgebra::Point2;

use crate::{
    geometry::homography::Homography,
    pipeline::guided_matching::{KeypointPair, MAX_CLOSER, PointIndex},
};

/// Expected number of guided inliers of `transform`, from query to tile, if the descriptors of a keypoint were in random order.
/// Points agree within `threshold_px`.
pub(crate) fn expected_inliers(
    transform: &Homography,
    keypoints: &KeypointPair<'_>,
    threshold_px: f64,
) -> f64 {
    let index = PointIndex::new(keypoints.tile_points);
    let of_tile = keypoints.tile_points.len().max(1) as f64;
    let mut near = Vec::new();
    let kept = |point: &Point2<f32>| {
        near.clear();
        index.near(transform, point.cast(), threshold_px, &mut near);
        ((MAX_CLOSER + 1) as f64 * near.len() as f64 / of_tile).min(1.0)
    };
    keypoints.points.iter().map(kept).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn expected_inliers_of_a_case_done_by_hand() {
        // Shifted by (5, -2): the first two keypoints land on one and on two keypoints of the tile, the third on none.
        let shift = Matrix3::new(1.0, 0.0, 5.0, 0.0, 1.0, -2.0, 0.0, 0.0, 1.0);
        let transform = Homography::from_matrix(shift).unwrap();
        let points = [(10.0, 10.0), (50.0, 50.0), (90.0, 90.0)].map(|(x, y)| Point2::new(x, y));
        let tile_points = [(15.0, 9.0), (54.0, 48.0), (56.0, 48.0), (200.0, 200.0)]
            .map(|(x, y)| Point2::new(x, y));
        let keypoints = KeypointPair {
            points: &points,
            scores: &[1.0; 3],
            tile_points: &tile_points,
        };
        // Two of four ranks are kept for one keypoint nearby, all of them for two.
        let by_hand = 2.0 * 1.0 / 4.0 + 1.0;
        let expected = expected_inliers(&transform, &keypoints, 3.0);
        assert!((expected - by_hand).abs() < 1e-12);
    }
}
