//! How many of a transform's inliers chance would give: the background model of an a-contrario test (Moisan and Stival 2004;
//! Moulon, Monasse and Marlet 2012, AC-RANSAC).
//!
//! Guided matching gathers matches along the very transform that it supports, so their number alone is no evidence. Counted here
//! are the mutual matches that agree with the final transform, which were found without it, and the number of guided matches that
//! the same search would keep if descriptors said nothing.

use nalgebra::Point2;

use crate::{
    geometry::{correspondence::Correspondence, homography::Homography, transform::Transform as _},
    pipeline::guided_matching::{KeypointIndex, KeypointPair, MAX_CLOSER},
};

/// What chance contributes to the inliers of a transform.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Chance {
    /// Matches that were found without the transform.
    pub mutual_matches: usize,
    /// Those that agree with it.
    pub mutual_inliers: usize,
    /// Keypoints of the query with a keypoint of the tile where the transform maps them.
    pub visible: usize,
    /// Expected number of guided inliers if the descriptors of a keypoint were in random order.
    pub expected_inliers: f64,
}

impl Chance {
    /// Counts for `transform`, from query to tile; points agree within `threshold_px`.
    pub fn along(
        transform: &Homography,
        keypoints: &KeypointPair<'_>,
        mutual: &[Correspondence],
        threshold_px: f64,
    ) -> Self {
        let agrees = |pair: &&Correspondence| {
            transform
                .map(pair.from)
                .is_some_and(|at| nalgebra::distance(&at, &pair.to) <= threshold_px)
        };
        let index = KeypointIndex::new(keypoints.tile_points);
        let of_tile = keypoints.tile_points.len().max(1) as f64;
        let mut near = Vec::new();
        let mut chance = Self {
            mutual_matches: mutual.len(),
            mutual_inliers: mutual.iter().filter(agrees).count(),
            ..Self::default()
        };
        for point in &keypoints.query.points {
            let from: Point2<f64> = point.cast();
            near.clear();
            index.near(transform, from, threshold_px, &mut near);
            if near.is_empty() {
                continue;
            }
            chance.visible += 1;
            let kept = (MAX_CLOSER + 1) as f64 * near.len() as f64 / of_tile;
            chance.expected_inliers += kept.min(1.0);
        }
        chance
    }
}
