//! Pairs of matched points and their normalisation.

use nalgebra::{Matrix3, Point2, Vector2};

/// A point of one picture and the point of another that it was matched with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// Point of the picture that is mapped from, pixels.
    pub from: Point2<f64>,
    /// Point of the picture that is mapped to, pixels.
    pub to: Point2<f64>,
    /// Weight in least squares, positive: the keypoint probability P of the paper's refinement (section 3.5.3).
    pub weight: f64,
}

impl Correspondence {
    /// A pair of weight one.
    pub fn new(from: Point2<f64>, to: Point2<f64>) -> Self {
        Self {
            from,
            to,
            weight: 1.0,
        }
    }

    /// A pair of the given weight.
    pub fn weighted(from: Point2<f64>, to: Point2<f64>, weight: f64) -> Self {
        Self { from, to, weight }
    }
}

/// Isotropic normalisation of points: centroid to the origin, mean distance to sqrt(2)
/// (Hartley, "In defence of the eight-point algorithm", 1997).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normalisation {
    /// Centroid, pixels.
    pub centre: Point2<f64>,
    /// Factor applied after the centroid is subtracted, 1 / pixels.
    pub scale: f64,
}

impl Normalisation {
    /// The normalisation of `points`; `None` if all points coincide or a coordinate is not finite.
    pub fn of(points: impl Iterator<Item = Point2<f64>> + Clone) -> Option<Self> {
        let (mut sum, mut count) = (Vector2::zeros(), 0.0);
        for point in points.clone() {
            sum += point.coords;
            count += 1.0;
        }
        let centre = Point2::from(sum / count);
        let mean_distance = points.map(|point| (point - centre).norm()).sum::<f64>() / count;
        let scale = std::f64::consts::SQRT_2 / mean_distance;
        // Points that are closer together than rounding errors coincide.
        let resolution = f64::EPSILON * (1.0 + centre.coords.norm());
        (scale.is_finite() && mean_distance > 16.0 * resolution).then_some(Self { centre, scale })
    }

    /// Into normalised coordinates.
    pub fn apply(&self, point: Point2<f64>) -> Point2<f64> {
        Point2::from((point - self.centre) * self.scale)
    }

    /// As a matrix acting on homogeneous pixels.
    pub fn matrix(&self) -> Matrix3<f64> {
        let (s, c) = (self.scale, self.centre);
        Matrix3::new(s, 0.0, -s * c.x, 0.0, s, -s * c.y, 0.0, 0.0, 1.0)
    }

    /// The matrix back to pixels.
    pub fn inverse_matrix(&self) -> Matrix3<f64> {
        let (s, c) = (1.0 / self.scale, self.centre);
        Matrix3::new(s, 0.0, c.x, 0.0, s, c.y, 0.0, 0.0, 1.0)
    }
}

/// Twice the signed area of the triangle `a b c`, square pixels; positive if the turn is from x towards y.
pub(crate) fn doubled_area(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}
