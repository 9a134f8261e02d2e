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
        for point in keypoints.points {
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

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn counts_of_a_case_done_by_hand() {
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
        let mutual = [(0, 0), (1, 3), (2, 2)].map(|(query, tile): (usize, usize)| {
            Correspondence::new(points[query].cast(), tile_points[tile])
        });
        let chance = Chance::along(&transform, &keypoints, &mutual, 3.0);
        assert_eq!((chance.mutual_matches, chance.mutual_inliers), (3, 1));
        assert_eq!(chance.visible, 2);
        // Two of four ranks are kept for one keypoint nearby, all of them for two.
        let by_hand = 2.0 * 1.0 / 4.0 + 1.0;
        assert!((chance.expected_inliers - by_hand).abs() < 1e-12);
    }
}
