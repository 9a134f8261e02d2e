//! The interface that similarity and homography share.

use nalgebra::{Matrix3, Point2, SMatrix, SVector};

use crate::geometry::correspondence::Normalisation;

/// A plane-to-plane transform with `N` free parameters, from one picture's pixels to another's.
pub trait Transform<const N: usize>: Copy + Send + Sync + std::fmt::Debug {
    /// The parameters, in the order of [`Transform::parameter_jacobian`]'s columns.
    fn parameters(&self) -> SVector<f64, N>;

    /// The transform of the same kind with other parameters.
    fn with_parameters(&self, parameters: &SVector<f64, N>) -> Self;

    /// Maps a point; `None` if it is on the line at infinity, or behind it and the transform does not map such points.
    fn map(&self, point: Point2<f64>) -> Option<Point2<f64>>;

    /// Derivative of the mapped point by the parameters, 2 x N; `None` if [`Transform::map`] returns `None`.
    fn parameter_jacobian(&self, point: Point2<f64>) -> Option<SMatrix<f64, 2, N>>;

    /// The same transform acting between normalised coordinates: `to * self * from^-1`.
    fn normalised(&self, from: &Normalisation, to: &Normalisation) -> Option<Self>;

    /// The inverse of [`Transform::normalised`].
    fn denormalised(&self, from: &Normalisation, to: &Normalisation) -> Option<Self>;

    /// As a matrix acting on homogeneous pixels.
    fn matrix(&self) -> Matrix3<f64>;

    /// Squared distance between the mapped point and `to`, square pixels; infinite if the point cannot be mapped.
    fn squared_error(&self, from: Point2<f64>, to: Point2<f64>) -> f64 {
        self.map(from)
            .map_or(f64::INFINITY, |mapped| (mapped - to).norm_squared())
    }
}
