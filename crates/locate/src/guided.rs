//! Guided matching (Hartley & Zisserman 2004, section 4.7.1): once a transform is known, each keypoint of the photo is compared
//! with those of the map near the place that the transform gives it. A right transform finds many more matches so, spread over
//! the whole photo; a wrong one finds hardly any.

use nalgebra::Point2;

use crate::{homography::Homography, transform::Transform as _};

/// Matches that guidance adds may have this many keypoints of the tile that are more similar.
pub(crate) const MAX_CLOSER: usize = 1;

/// Keypoints of a tile by place.
pub(crate) struct Places<'a> {
    points: &'a [Point2<f64>],
    /// Indices of the points from top to bottom.
    by_y: Vec<usize>,
}

impl<'a> Places<'a> {
    /// Sorts the points.
    pub fn new(points: &'a [Point2<f64>]) -> Self {
        let mut by_y: Vec<usize> = (0..points.len()).collect();
        by_y.sort_by(|&a, &b| points[a].y.total_cmp(&points[b].y));
        Self { points, by_y }
    }

    /// Appends the points within `reach_px` of the place that `transform` gives `from`.
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
