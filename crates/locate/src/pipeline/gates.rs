//! Checks that an estimated transform must pass before it becomes a fix. A wrong fix is worse than none.
//!
//! The limits are those that other systems converged on (GISNav, AnyVisLoc, wildnav and their issue threads).

use nalgebra::{Matrix2, Point2};

use crate::{
    confidence::ALIKE_INLIERS,
    geometry::{
        distribution::{occupied_cells, spread},
        homography::Homography,
        transform::Transform,
    },
    options::Gates,
    outcome::Rejection,
};

/// Ratio of the inliers to those of a place that looks alike below which neither is an answer.
const ALIKE_MARGIN: f64 = 1.25;

/// The local distortion of a homography at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// Geometric mean of the two principal scales.
    pub scale: f64,
    /// Difference of the two principal scales over their geometric mean.
    pub shear: f64,
    /// Relative change of the homogeneous denominator per pixel.
    pub perspective_per_px: f64,
}

impl Shape {
    /// The local distortion of `homography` at `point`, or the rejection if it is singular or mirrors the picture.
    pub fn at(homography: &Homography, point: Point2<f64>) -> Result<Self, Rejection> {
        let jacobian: Matrix2<f64> = homography
            .point_jacobian(point)
            .ok_or(Rejection::NotFinite)?;
        let area = jacobian.determinant();
        let mapped = homography.map(point).ok_or(Rejection::NotFinite)?;
        if !area.is_finite()
            || !mapped
                .coords
                .iter()
                .all(|coordinate| coordinate.is_finite())
        {
            return Err(Rejection::NotFinite);
        }
        if area < 0.0 {
            return Err(Rejection::Mirrored);
        }
        let scale = area.sqrt();
        if !(scale > 1e-9) {
            return Err(Rejection::NotFinite);
        }
        // With singular values s1 >= s2: s1^2 + s2^2 is the squared Frobenius norm, s1 s2 the determinant.
        let shear = (jacobian.norm_squared() - 2.0 * area).max(0.0).sqrt() / scale;
        let m = homography.as_matrix();
        let denominator = m[(2, 0)] * point.x + m[(2, 1)] * point.y + m[(2, 2)];
        let perspective_per_px = m[(2, 0)].hypot(m[(2, 1)]) / denominator.abs();
        Ok(Self {
            scale,
            shear,
            perspective_per_px,
        })
    }
}

impl Gates {
    /// Checks the shape of `homography` at the photo's `centre`, against an expected scale.
    ///
    /// # Errors
    /// The first limit that it does not keep.
    pub(crate) fn check_shape(
        &self,
        homography: &Homography,
        centre: Point2<f64>,
        expected_scale: f64,
    ) -> Result<Shape, Rejection> {
        let shape = Shape::at(homography, centre)?;
        let factor = shape.scale / expected_scale;
        if !(factor.max(1.0 / factor) <= 1.0 + self.max_scale_change) {
            return Err(Rejection::Scale { factor });
        }
        if !(shape.shear <= self.max_shear) {
            return Err(Rejection::Shear { shear: shape.shear });
        }
        if !(shape.perspective_per_px <= self.max_perspective_per_px) {
            return Err(Rejection::Perspective {
                per_px: shape.perspective_per_px,
            });
        }
        Ok(shape)
    }

    /// Checks number, share and distribution of the inliers. `inliers` are their positions on the photo, `matches` the number of
    /// matches.
    ///
    /// # Errors
    /// The first limit that they do not keep.
    pub(crate) fn check_support(
        &self,
        inliers: impl Iterator<Item = Point2<f64>> + Clone,
        matches: usize,
        half_side_px: f64,
    ) -> Result<(), Rejection> {
        let found = inliers.clone().count();
        if found < self.min_inliers {
            return Err(Rejection::Inliers {
                found,
                needed: self.min_inliers,
            });
        }
        let share = found as f64 / matches.max(1) as f64;
        if share < self.min_inlier_share {
            return Err(Rejection::InlierShare {
                percent: share * 100.0,
            });
        }
        let found = occupied_cells(inliers.clone(), half_side_px);
        if found < self.min_places {
            return Err(Rejection::Places {
                found,
                needed: self.min_places,
            });
        }
        let spread = spread(inliers, half_side_px);
        if !(spread >= self.min_spread) {
            return Err(Rejection::Spread { spread });
        }
        Ok(())
    }

    /// Checks the confidence against `needed`, or against [`Gates::min_confidence`] if that is set.
    ///
    /// # Errors
    /// [`Rejection::Confidence`] if it is lower and [`Gates::by_confidence`] is set.
    pub fn check_confidence(&self, confidence: f64, needed: f64) -> Result<(), Rejection> {
        let needed = self.min_confidence.unwrap_or(needed);
        if self.by_confidence && !(confidence >= needed) {
            return Err(Rejection::Confidence {
                percent: confidence * 100.0,
                needed_percent: needed * 100.0,
            });
        }
        Ok(())
    }

    /// Checks the share of the photo that lies on the map, 0 to 1.
    ///
    /// # Errors
    /// [`Rejection::OnMap`] if it is below [`Gates::min_on_map`].
    pub fn check_on_map(&self, share: f64) -> Result<(), Rejection> {
        if !(share >= self.min_on_map) {
            return Err(Rejection::OnMap {
                percent: share * 100.0,
                needed_percent: self.min_on_map * 100.0,
            });
        }
        Ok(())
    }

    /// Checks the ratio of the inliers to those of the best candidate at another position: always where that is a place that looks alike.
    ///
    /// # Errors
    /// [`Rejection::Ambiguous`] if it is too small.
    pub fn check_margin(&self, inliers: usize, runner_up: usize) -> Result<(), Rejection> {
        let margin = if runner_up < ALIKE_INLIERS {
            self.min_margin
        } else {
            self.min_margin.max(ALIKE_MARGIN)
        };
        if (inliers as f64) < margin * runner_up as f64 {
            return Err(Rejection::Ambiguous { inliers, runner_up });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    const CENTRE: Point2<f64> = Point2::new(256.0, 256.0);

    /// A linear map around the centre, with a perspective row that vanishes there.
    fn around_centre(linear: Matrix2<f64>, perspective: f64) -> Homography {
        let to = Matrix3::new(1.0, 0.0, 256.0, 0.0, 1.0, 256.0, 0.0, 0.0, 1.0);
        let from = Matrix3::new(1.0, 0.0, -256.0, 0.0, 1.0, -256.0, 0.0, 0.0, 1.0);
        let l = linear;
        let middle = Matrix3::new(
            l[(0, 0)],
            l[(0, 1)],
            0.0,
            l[(1, 0)],
            l[(1, 1)],
            0.0,
            perspective,
            0.0,
            1.0,
        );
        Homography::from_matrix(to * middle * from).unwrap()
    }

    fn check(linear: Matrix2<f64>, perspective: f64) -> Result<Shape, Rejection> {
        Gates::default().check_shape(&around_centre(linear, perspective), CENTRE, 1.0)
    }

    #[test]
    fn shape_gates_hold_their_limits() {
        let scale = |s: f64| Matrix2::new(s, 0.0, 0.0, s);
        assert!(check(scale(1.34), 0.0).is_ok());
        assert!(check(scale(1.0 / 1.34), 0.0).is_ok());
        assert!(matches!(
            check(scale(1.36), 0.0),
            Err(Rejection::Scale { .. })
        ));
        assert!(matches!(
            check(scale(1.0 / 1.36), 0.0),
            Err(Rejection::Scale { .. })
        ));
        assert!(check(Matrix2::new(0.0, -1.0, 1.0, 0.0), 0.0).is_ok());
        assert_eq!(
            check(Matrix2::new(-1.0, 0.0, 0.0, 1.0), 0.0),
            Err(Rejection::Mirrored)
        );
        assert!(check(Matrix2::new(1.0, 0.24, 0.0, 1.0), 0.0).is_ok());
        assert!(matches!(
            check(Matrix2::new(1.0, 0.26, 0.0, 1.0), 0.0),
            Err(Rejection::Shear { .. })
        ));
        assert!(matches!(
            check(Matrix2::new(1.14, 0.0, 0.0, 0.88), 0.0),
            Err(Rejection::Shear { .. })
        ));
        assert!(check(scale(1.0), 0.9e-3).is_ok());
        assert!(matches!(
            check(scale(1.0), 1.1e-3),
            Err(Rejection::Perspective { .. })
        ));
        assert!(matches!(
            check(Matrix2::zeros(), 0.0),
            Err(Rejection::NotFinite)
        ));
        let shape = check(Matrix2::new(1.0, 0.2, 0.0, 1.0), 5e-4).unwrap();
        assert!((shape.shear - 0.2).abs() < 1e-12);
        assert!((shape.perspective_per_px - 5e-4).abs() < 1e-12);
    }

    #[test]
    fn support_gates_hold_their_limits() {
        let gates = Gates::default();
        let grid = |count: usize, side: f64| {
            (0..count)
                .map(move |i| Point2::new((i % 5) as f64 * side, (i / 5) as f64 * side))
                .collect::<Vec<_>>()
        };
        assert!(
            gates
                .check_support(grid(25, 60.0).into_iter(), 60, 256.0)
                .is_ok()
        );
        let few = gates.check_support(grid(gates.min_inliers - 1, 60.0).into_iter(), 60, 256.0);
        assert!(matches!(few, Err(Rejection::Inliers { .. })));
        let crowded = gates.check_support(grid(25, 5.0).into_iter(), 60, 256.0);
        assert!(matches!(crowded, Err(Rejection::Places { .. })));
        let line = (0..40).map(|i| Point2::new(f64::from(i) * 16.0, 9.0 * f64::from(i)));
        assert!(matches!(
            gates.check_support(line, 60, 256.0),
            Err(Rejection::Spread { .. })
        ));
        let strict = Gates {
            min_inlier_share: 0.5,
            ..gates
        };
        let lost = strict.check_support(grid(25, 60.0).into_iter(), 60, 256.0);
        assert!(matches!(lost, Err(Rejection::InlierShare { .. })));
        assert!(gates.check_confidence(0.97, 0.97).is_ok());
        assert!(gates.check_confidence(f64::NAN, 0.5).is_err());
        let bold = Gates {
            min_confidence: Some(0.1),
            ..gates
        };
        assert!(bold.check_confidence(0.2, 0.97).is_ok());
        let calibrated = gates.with_calibration();
        assert!(calibrated.check_margin(25, 24).is_ok());
        assert!(calibrated.check_margin(60, 46).is_ok());
        assert!(matches!(
            calibrated.check_margin(243, 232),
            Err(Rejection::Ambiguous { .. })
        ));
        assert!(gates.check_margin(25, 20).is_ok());
        assert!(matches!(
            gates.check_margin(24, 20),
            Err(Rejection::Ambiguous { .. })
        ));
    }

    #[test]
    fn inliers_in_one_cell_count_once() {
        let gates = Gates::default();
        // Forty on a tree crown of a tenth of the photo's width, and two far away so that the spread is large.
        let crowd =
            (0..40).map(|i| Point2::new(100.0 + f64::from(i % 7) * 5.0, 100.0 + f64::from(i)));
        let far = [Point2::new(480.0, 20.0), Point2::new(30.0, 400.0)];
        let crowded = crowd.chain(far);
        assert!(matches!(
            gates.check_support(crowded, 100, 256.0),
            Err(Rejection::Places { needed: 15, .. })
        ));
        let everywhere =
            (0..40).map(|i| Point2::new(f64::from(i % 8) * 60.0, f64::from(i / 8) * 90.0));
        assert_eq!(gates.check_support(everywhere, 100, 256.0), Ok(()));
    }

    #[test]
    fn a_photo_that_lies_mostly_beside_the_map_is_refused() {
        let gates = Gates::default();
        assert!(gates.check_on_map(0.5).is_ok());
        for share in [0.49, 0.0, f64::NAN] {
            assert!(matches!(
                gates.check_on_map(share),
                Err(Rejection::OnMap { .. })
            ));
        }
    }

    #[test]
    fn a_calibrated_confidence_takes_the_place_of_the_limits_on_support() {
        let few = || (0..8).map(|i| Point2::new(f64::from(i) * 60.0, f64::from(i % 3) * 150.0));
        let uncalibrated = Gates::default();
        assert!(uncalibrated.check_support(few(), 100, 200.0).is_err());
        assert!(uncalibrated.check_margin(20, 19).is_err());
        let calibrated = uncalibrated.with_calibration();
        assert!(calibrated.check_support(few(), 100, 200.0).is_ok());
        assert!(calibrated.check_margin(20, 19).is_ok());
        let without = Gates {
            by_confidence: false,
            ..uncalibrated
        };
        assert_eq!(without.with_calibration(), without);
    }
}
