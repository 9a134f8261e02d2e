//! Guided matching (Hartley & Zisserman 2004, section 4.7.1): once a transform is known, each keypoint of the photo is compared
//! with those of the map near the place that the transform gives it. A right transform finds many more matches so, spread over
//! the whole photo; a wrong one finds hardly any.

use std::collections::HashSet;

use nalgebra::Point2;

use crate::{
    correspondence::Correspondence,
    homography::Homography,
    matching::{Compared, Match},
    options::Options,
    query_features::QueryFeatures,
    solve::{Expected, Solved, solve_from},
    transform::Transform as _,
};

/// Matches that guidance adds may have this many keypoints of the tile that are more similar.
const MAX_CLOSER: usize = 1;
/// How far from its place a keypoint is looked for, once and then again from the transform that this gave, thresholds of RANSAC.
const REACH: [f64; 2] = [2.0, 1.0];

/// What is matched: a query, and a tile's keypoints at the query's resolution.
pub(crate) struct Sides<'a> {
    pub query: &'a QueryFeatures,
    pub tile_points: &'a [Point2<f64>],
}

impl Sides<'_> {
    /// The matched points, each pair weighted by the probability of the query's keypoint.
    pub fn pairs<'m>(&self, matches: impl IntoIterator<Item = &'m Match>) -> Vec<Correspondence> {
        let pair = |found: &Match| {
            Correspondence::weighted(
                self.query.points[found.query as usize].cast::<f64>(),
                self.tile_points[found.tile as usize],
                f64::from(self.query.scores[found.query as usize]),
            )
        };
        matches.into_iter().map(pair).collect()
    }
}

/// Matches anew about the transform of `start`, and fits it to what is found; the pairs to which its inliers belong. Those of
/// `plain`, matched without guidance, that found no place among them come last. `None` where no transform fits.
pub(crate) fn guide(
    compared: &mut Compared<'_>,
    sides: &Sides<'_>,
    plain: &[Match],
    start: &Solved,
    expected: Expected,
    options: &Options,
    guided: &mut Vec<Match>,
) -> Option<(Solved, Vec<Correspondence>)> {
    let places = Places::new(sides.tile_points);
    let mut solved = start.clone();
    let mut pairs = Vec::new();
    for reach in REACH {
        let reach_px = reach * options.ransac.threshold_px;
        compared.guided(
            |row, near| {
                let from = sides.query.points[row].cast::<f64>();
                places.near(&solved.homography, from, reach_px, near);
            },
            MAX_CLOSER,
            guided,
        );
        pairs = sides.pairs(&*guided);
        solved = solve_from(&solved, &pairs, expected, options)?;
    }
    let taken: HashSet<u32> = guided.iter().map(|found| found.query).collect();
    pairs.extend(sides.pairs(plain.iter().filter(|found| !taken.contains(&found.query))));
    Some((solved, pairs))
}

/// Keypoints of a tile by place.
struct Places<'a> {
    points: &'a [Point2<f64>],
    /// Indices of the points from top to bottom.
    by_y: Vec<usize>,
}

impl<'a> Places<'a> {
    /// Sorts the points.
    fn new(points: &'a [Point2<f64>]) -> Self {
        let mut by_y: Vec<usize> = (0..points.len()).collect();
        by_y.sort_by(|&a, &b| points[a].y.total_cmp(&points[b].y));
        Self { points, by_y }
    }

    /// Appends the points within `reach_px` of the place that `transform` gives `from`.
    fn near(
        &self,
        transform: &Homography,
        from: Point2<f64>,
        reach_px: f64,
        found: &mut Vec<usize>,
    ) {
        let Some(at) = transform.map(from) else {
            return;
        };
        let top = at.y - reach_px;
        let first = self
            .by_y
            .partition_point(|&index| self.points[index].y < top);
        let below = self.by_y[first..].iter().copied();
        found.extend(
            below
                .take_while(|&index| self.points[index].y <= at.y + reach_px)
                .filter(|&index| {
                    nalgebra::distance_squared(&self.points[index], &at) <= reach_px.powi(2)
                }),
        );
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn near_points_are_those_within_reach_of_the_mapped_place() {
        let points = [
            (10.0, 10.0),
            (14.0, 10.0),
            (10.0, 13.5),
            (12.9, 12.9),
            (40.0, 10.0),
        ];
        let points = points.map(|(x, y)| Point2::new(x, y));
        let places = Places::new(&points);
        let shift = Matrix3::new(1.0, 0.0, 5.0, 0.0, 1.0, -2.0, 0.0, 0.0, 1.0);
        let shift = Homography::from_matrix(shift).unwrap();
        let mut found = Vec::new();
        places.near(&shift, Point2::new(5.0, 12.0), 4.0, &mut found);
        found.sort_unstable();
        assert_eq!(found, [0, 1, 2], "the fourth is 4.1 px away");
        found.clear();
        places.near(&shift, Point2::new(200.0, 12.0), 4.0, &mut found);
        assert!(found.is_empty());
    }
}
