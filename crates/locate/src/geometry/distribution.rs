//! How points are distributed over a photo.

use std::collections::HashSet;

use nalgebra::{Matrix2, Point2, Vector2};

/// Number of grid cells per half side of the photo.
const CELLS_PER_HALF_SIDE: f64 = 6.0;

/// Smallest side of a grid cell, pixels: keypoints that are closer share most of what their descriptors see.
const MIN_CELL_PX: f64 = 20.0;

/// Standard deviation of `points` along their short axis, over `half_side_px`; 0 for fewer than two points.
pub(crate) fn spread(points: impl Iterator<Item = Point2<f64>> + Clone, half_side_px: f64) -> f64 {
    let count = points.clone().count() as f64;
    if count < 2.0 {
        return 0.0;
    }
    let mean = points
        .clone()
        .fold(Vector2::zeros(), |sum, point| sum + point.coords)
        / count;
    let scatter = points.fold(Matrix2::zeros(), |sum, point| {
        let d = point.coords - mean;
        sum + d * d.transpose()
    }) / count;
    let apart = ((scatter[(0, 0)] - scatter[(1, 1)]) / 2.0).hypot(scatter[(0, 1)]);
    (scatter.trace() / 2.0 - apart).max(0.0).sqrt() / half_side_px
}

/// Number of grid cells, a twelfth of the photo's mean side wide and at least [`MIN_CELL_PX`], that hold at least one of `points`.
///
/// Keypoints cluster on tree crowns and edges, and a wrong match often has neighbours with the same wrong translation. A cell
/// counts them once.
pub(crate) fn occupied_cells(
    points: impl Iterator<Item = Point2<f64>>,
    half_side_px: f64,
) -> usize {
    let side_px = (half_side_px / CELLS_PER_HALF_SIDE).max(MIN_CELL_PX);
    points
        .map(|point| [point.x, point.y].map(|along| (along / side_px).floor() as i64))
        .collect::<HashSet<_>>()
        .len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_one_cell_count_once() {
        // A crowd of a tenth of the photo's width, and two points far away.
        let crowd =
            (0..40).map(|i| Point2::new(100.0 + f64::from(i % 7) * 5.0, 100.0 + f64::from(i)));
        let far = [Point2::new(480.0, 20.0), Point2::new(30.0, 400.0)];
        assert!(occupied_cells(crowd.chain(far), 256.0) <= 6);
        let everywhere =
            (0..40).map(|i| Point2::new(f64::from(i % 8) * 60.0, f64::from(i / 8) * 90.0));
        assert_eq!(occupied_cells(everywhere, 256.0), 40);
    }

    #[test]
    fn spread_is_that_of_the_short_axis() {
        // A cross with arms of 40 and 10 pixels: variances of 2 * 40^2 / 4 and 2 * 10^2 / 4.
        let cross = [(40.0, 0.0), (-40.0, 0.0), (0.0, 10.0), (0.0, -10.0)];
        let points = cross.map(|(x, y)| Point2::new(x, y)).into_iter();
        assert!((spread(points.clone(), 100.0) - 50f64.sqrt() / 100.0).abs() < 1e-12);
        assert_eq!(spread(points.take(1), 100.0), 0.0);
    }
}
