//! Guided matching (Hartley & Zisserman 2004, algorithm 4.6): with a transform known, each keypoint of the photo is compared with
//! the keypoints of the map near the position that the transform predicts. A right transform gains many matches by it, spread over
//! the whole photo; a wrong one gains hardly any.

use std::collections::HashSet;

use nalgebra::Point2;

use crate::{
    geometry::{
        correspondence::Correspondence,
        estimation::{EstimatedTransform, EstimationOptions, estimate_from},
        homography::Homography,
        transform::Transform as _,
    },
    search::matching::{Match, Similarities},
};

/// A guided match is kept if at most this many keypoints of the whole tile are more similar.
pub(crate) const MAX_CLOSER: usize = 1;
/// Search radius of each iteration, in thresholds of RANSAC. Each iteration starts from the transform of the one before.
const SEARCH_RADII: [f64; 2] = [2.0, 1.0];

/// The keypoints that are matched: those of a query, and those of a tile (or of another photo) at the query's resolution.
pub(crate) struct KeypointPair<'a> {
    pub points: &'a [Point2<f32>],
    /// Probabilities of the query's keypoints.
    pub scores: &'a [f32],
    pub tile_points: &'a [Point2<f64>],
}

impl KeypointPair<'_> {
    /// The points of `matches`, each pair weighted by the probability of the query's keypoint.
    pub fn pairs<'m>(&self, matches: impl IntoIterator<Item = &'m Match>) -> Vec<Correspondence> {
        let pair = |found: &Match| {
            Correspondence::weighted(
                self.points[found.query as usize].cast::<f64>(),
                self.tile_points[found.tile as usize],
                f64::from(self.scores[found.query as usize]),
            )
        };
        matches.into_iter().map(pair).collect()
    }
}

/// Matches again around the transform of `start` and fits it to the new matches. Returns the transform with the pairs to which its
/// inliers belong; `unguided` matches whose keypoint has no guided match come last. Returns `None` if no transform fits.
pub(crate) fn match_guided(
    similarities: &mut Similarities<'_>,
    keypoints: &KeypointPair<'_>,
    unguided: &[Match],
    start: &EstimatedTransform,
    options: &EstimationOptions,
    guided: &mut Vec<Match>,
) -> Option<(EstimatedTransform, Vec<Correspondence>)> {
    let index = PointIndex::new(keypoints.tile_points);
    let mut estimated = start.clone();
    let mut pairs = Vec::new();
    for radius in SEARCH_RADII {
        let radius_px = radius * options.ransac.threshold_px;
        similarities.guided(
            |row, near| {
                let from = keypoints.points[row].cast::<f64>();
                index.near(&estimated.homography, from, radius_px, near);
            },
            MAX_CLOSER,
            guided,
        );
        pairs = keypoints.pairs(&*guided);
        estimated = estimate_from(&estimated, &pairs, options)?;
    }
    let taken: HashSet<u32> = guided.iter().map(|found| found.query).collect();
    pairs.extend(
        keypoints.pairs(
            unguided
                .iter()
                .filter(|found| !taken.contains(&found.query)),
        ),
    );
    Some((estimated, pairs))
}

/// Keypoints of a tile, found by their position (by descriptor: [`grimnet_pack::KeypointIndex`]).
pub(crate) struct PointIndex {
    /// The points from top to bottom, each with its index.
    by_y: Vec<(Point2<f64>, usize)>,
}

impl PointIndex {
    /// Builds the index.
    pub fn new(points: &[Point2<f64>]) -> Self {
        let mut by_y: Vec<(Point2<f64>, usize)> = points.iter().copied().zip(0..).collect();
        by_y.sort_by(|(a, _), (b, _)| a.y.total_cmp(&b.y));
        Self { by_y }
    }

    /// Appends the indices of the points within `reach_px` of the position to which `transform` maps `from`.
    pub fn near(
        &self,
        transform: &Homography,
        from: Point2<f64>,
        reach_px: f64,
        found: &mut Vec<usize>,
    ) {
        let Some(at) = transform.map(from) else {
            return;
        };
        let (top, bottom) = (at.y - reach_px, at.y + reach_px);
        let first = self.by_y.partition_point(|(point, _)| point.y < top);
        let below = self.by_y[first..].iter();
        found.extend(
            below
                .take_while(|(point, _)| point.y <= bottom)
                .filter(|(point, _)| nalgebra::distance_squared(point, &at) <= reach_px * reach_px)
                .map(|&(_, index)| index),
        );
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn near_points_are_those_within_reach_of_the_mapped_position() {
        let points = [
            (10.0, 10.0),
            (14.0, 10.0),
            (10.0, 13.5),
            (12.9, 12.9),
            (40.0, 10.0),
        ];
        let points = points.map(|(x, y)| Point2::new(x, y));
        let index = PointIndex::new(&points);
        let shift = Matrix3::new(1.0, 0.0, 5.0, 0.0, 1.0, -2.0, 0.0, 0.0, 1.0);
        let shift = Homography::from_matrix(shift).unwrap();
        let mut found = Vec::new();
        index.near(&shift, Point2::new(5.0, 12.0), 4.0, &mut found);
        found.sort_unstable();
        assert_eq!(found, [0, 1, 2], "the fourth is 4.1 px away");
        found.clear();
        index.near(&shift, Point2::new(200.0, 12.0), 4.0, &mut found);
        assert!(found.is_empty());
    }
}
