//! The homography without checks, as the paper estimates it: plain RANSAC-DLT (section 3.5.3).

use crate::geometry::{
    correspondence::Correspondence, homography::Homography, ransac::Estimator, transform::Transform,
};

/// Fits homographies for [`crate::geometry::ransac::Ransac`] by the direct linear transform (Hartley & Zisserman 2004, algorithm 4.1)
/// and nothing else: a sample counts however small its triangles are, whether it mirrors the points or not, and on whichever side
/// of the line at infinity they lie.
#[derive(Debug, Clone, Copy, Default)]
pub struct PlainHomographyEstimator;

impl Estimator for PlainHomographyEstimator {
    type Model = Homography;
    const SAMPLE_SIZE: usize = 4;

    /// `None` only where the linear system has no unique solution (three collinear or repeated points), or the homography maps the
    /// origin to infinity, so that its last entry cannot be one.
    fn fit_sample(&self, sample: &[Correspondence]) -> Option<Homography> {
        Homography::through(sample.try_into().ok()?).map(Homography::mapping_behind)
    }

    fn fit_all(&self, pairs: &[Correspondence]) -> Option<Homography> {
        Homography::fit_unchecked(pairs).map(Homography::mapping_behind)
    }

    fn squared_error(&self, model: &Homography, pair: &Correspondence) -> f64 {
        model.squared_error(pair.from, pair.to)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point2};

    use super::*;
    use crate::geometry::homography::HomographyEstimator;

    fn pairs(matrix: Matrix3<f64>, points: [[f64; 2]; 4]) -> Vec<Correspondence> {
        let model = Homography::from_matrix(matrix).unwrap().mapping_behind();
        let pair = |[x, y]: [f64; 2]| {
            let from = Point2::new(x, y);
            Correspondence::new(from, model.map(from).unwrap())
        };
        points.map(pair).to_vec()
    }

    #[test]
    fn mirrored_small_and_split_samples_are_fitted_where_the_checked_estimator_refuses() {
        let square = [[10.0, 10.0], [200.0, 20.0], [190.0, 210.0], [5.0, 180.0]];
        let mirror = Matrix3::new(-1.0, 0.1, 300.0, 0.05, 1.0, 7.0, 1e-4, 2e-4, 1.0);
        // The line at infinity, x = 100, lies between the points.
        let split = Matrix3::new(1.0, 0.2, 3.0, 0.1, 0.9, 5.0, -0.01, 0.0, 1.0);
        let small = square.map(|point| point.map(|along| along / 100.0));
        for sample in [
            pairs(mirror, square),
            pairs(split, square),
            pairs(Matrix3::identity(), small),
        ] {
            assert!(HomographyEstimator::default().fit_sample(&sample).is_none());
            let model = PlainHomographyEstimator.fit_sample(&sample).unwrap();
            for pair in &sample {
                let error_px2 = PlainHomographyEstimator.squared_error(&model, pair);
                assert!(error_px2 < 1e-12, "{error_px2}");
            }
            let all = PlainHomographyEstimator.fit_all(&sample).unwrap();
            assert!((all.as_matrix() - model.as_matrix()).norm() < 1e-6 * model.as_matrix().norm());
        }
        let line = [[0.0, 0.0], [10.0, 10.0], [20.0, 20.0], [0.0, 50.0]];
        assert!(
            PlainHomographyEstimator
                .fit_sample(&pairs(Matrix3::identity(), line))
                .is_none()
        );
    }
}
