//! The homography by the normalised direct linear transform (Hartley & Zisserman 2004, algorithm 4.2), weighted.

use nalgebra::{Matrix2, Matrix3, Point2, SMatrix, SVector, SymmetricEigen, Vector3};

use crate::geometry::{
    correspondence::{Correspondence, Normalisation, doubled_area},
    ransac::Estimator,
    transform::Transform,
};

/// A 3 x 3 matrix acting on homogeneous pixels, scaled so that its last entry is one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homography {
    matrix: Matrix3<f64>,
    maps_behind: bool,
}

/// Points nearer to the line at infinity than this, in the scale of the matrix, are not mapped.
const MIN_DENOMINATOR: f64 = 1e-9;

impl Homography {
    /// The homography of a matrix of any scale; `None` if the matrix is not finite or maps the origin to infinity.
    pub fn from_matrix(matrix: Matrix3<f64>) -> Option<Self> {
        let last = matrix[(2, 2)];
        if !(last.abs() > 1e-12 * matrix.norm()) {
            return None;
        }
        let matrix = matrix / last;
        matrix
            .iter()
            .all(|entry| entry.is_finite())
            .then_some(Self {
                matrix,
                maps_behind: false,
            })
    }

    /// The same homography, mapping also points behind the line at infinity, which a camera above the ground does not see: the plain
    /// formula of the paper (section 3.5.3).
    #[must_use]
    pub fn mapping_behind(self) -> Self {
        Self {
            maps_behind: true,
            ..self
        }
    }

    /// The homography of another matrix that maps points behind the line at infinity if this one does.
    pub fn with_matrix(&self, matrix: Matrix3<f64>) -> Option<Self> {
        Some(Self {
            maps_behind: self.maps_behind,
            ..Self::from_matrix(matrix)?
        })
    }

    /// The homography of least weighted algebraic error over `pairs` in normalised coordinates. Returns `None` for fewer than four
    /// pairs, for collinear points, or if the homography mirrors the points or maps some of them across the line at infinity.
    pub fn fit(pairs: &[Correspondence]) -> Option<Self> {
        Self::fit_unchecked(pairs).filter(|model| model.keeps_sides(pairs))
    }

    /// As [`Homography::fit`], whichever way the homography maps the points.
    pub(crate) fn fit_unchecked(pairs: &[Correspondence]) -> Option<Self> {
        if pairs.len() < 4 {
            return None;
        }
        let from = Normalisation::of(pairs.iter().map(|pair| pair.from))?;
        let to = Normalisation::of(pairs.iter().map(|pair| pair.to))?;
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        for pair in pairs {
            let (p, q) = (from.apply(pair.from), to.apply(pair.to));
            let first = SVector::<f64, 9>::from([
                p.x,
                p.y,
                1.0,
                0.0,
                0.0,
                0.0,
                -q.x * p.x,
                -q.x * p.y,
                -q.x,
            ]);
            let second = SVector::<f64, 9>::from([
                0.0,
                0.0,
                0.0,
                p.x,
                p.y,
                1.0,
                -q.y * p.x,
                -q.y * p.y,
                -q.y,
            ]);
            normal.ger(pair.weight, &first, &first, 1.0);
            normal.ger(pair.weight, &second, &second, 1.0);
        }
        if !normal.iter().all(|entry| entry.is_finite()) {
            return None;
        }
        let eigen = SymmetricEigen::try_new(normal, 1e-15, 200)?;
        let mut order: Vec<usize> = (0..9).collect();
        order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
        // A second vanishing eigenvalue means that more than one homography fits: points are collinear or repeated.
        if !(eigen.eigenvalues[order[1]] > 1e-10 * eigen.eigenvalues[order[8]]) {
            return None;
        }
        let h = eigen.eigenvectors.column(order[0]);
        let in_normalised = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
        Self::from_matrix(to.inverse_matrix() * in_normalised * from.matrix())
    }

    /// The homography through exactly four pairs, by the projective bases of the two quadrangles; `None` for collinear
    /// points.
    pub fn through(sample: &[Correspondence; 4]) -> Option<Self> {
        let basis = |point: fn(&Correspondence) -> Point2<f64>| -> Option<Matrix3<f64>> {
            let columns =
                Matrix3::from_columns(&[0, 1, 2].map(|i| point(&sample[i]).to_homogeneous()));
            let weights: Vector3<f64> = columns.try_inverse()? * point(&sample[3]).to_homogeneous();
            Some(columns * Matrix3::from_diagonal(&weights))
        };
        Self::from_matrix(basis(|pair| pair.to)? * basis(|pair| pair.from)?.try_inverse()?)
    }

    /// The homography of a similarity or another matrix transform.
    pub fn of<const N: usize>(transform: &impl Transform<N>) -> Option<Self> {
        Self::from_matrix(transform.matrix())
    }

    /// The matrix, last entry one.
    pub fn as_matrix(&self) -> &Matrix3<f64> {
        &self.matrix
    }

    /// The inverse; `None` if the matrix is singular.
    pub fn inverse(&self) -> Option<Self> {
        self.with_matrix(self.matrix.try_inverse()?)
    }

    /// Derivative of the mapped point by the point, 2 x 2; `None` if [`Transform::map`] returns `None`.
    pub fn point_jacobian(&self, point: Point2<f64>) -> Option<Matrix2<f64>> {
        let mapped = self.map(point)?;
        let m = &self.matrix;
        let w = self.denominator(point);
        Some(Matrix2::new(
            (m[(0, 0)] - mapped.x * m[(2, 0)]) / w,
            (m[(0, 1)] - mapped.x * m[(2, 1)]) / w,
            (m[(1, 0)] - mapped.y * m[(2, 0)]) / w,
            (m[(1, 1)] - mapped.y * m[(2, 1)]) / w,
        ))
    }

    fn denominator(&self, point: Point2<f64>) -> f64 {
        self.matrix[(2, 0)] * point.x + self.matrix[(2, 1)] * point.y + self.matrix[(2, 2)]
    }

    /// Chirality: all points are on the same side of the line at infinity and not mirrored.
    fn keeps_sides(&self, pairs: &[Correspondence]) -> bool {
        let positive = pairs
            .iter()
            .all(|pair| self.denominator(pair.from) > MIN_DENOMINATOR);
        positive && self.matrix.determinant() > 0.0
    }
}

impl Transform<8> for Homography {
    fn parameters(&self) -> SVector<f64, 8> {
        let m = &self.matrix;
        SVector::from([
            m[(0, 0)],
            m[(0, 1)],
            m[(0, 2)],
            m[(1, 0)],
            m[(1, 1)],
            m[(1, 2)],
            m[(2, 0)],
            m[(2, 1)],
        ])
    }

    fn with_parameters(&self, p: &SVector<f64, 8>) -> Self {
        Self {
            matrix: Matrix3::new(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], 1.0),
            ..*self
        }
    }

    fn map(&self, point: Point2<f64>) -> Option<Point2<f64>> {
        let m = &self.matrix;
        let w = self.denominator(point);
        // Points behind the line at infinity would be seen from below the ground.
        let is_mapped = w > MIN_DENOMINATOR || self.maps_behind && w < -MIN_DENOMINATOR;
        is_mapped.then(|| {
            Point2::new(
                (m[(0, 0)] * point.x + m[(0, 1)] * point.y + m[(0, 2)]) / w,
                (m[(1, 0)] * point.x + m[(1, 1)] * point.y + m[(1, 2)]) / w,
            )
        })
    }

    fn parameter_jacobian(&self, point: Point2<f64>) -> Option<SMatrix<f64, 2, 8>> {
        let mapped = self.map(point)?;
        let w = self.denominator(point);
        let (x, y, one) = (point.x / w, point.y / w, 1.0 / w);
        let (u, v) = (mapped.x, mapped.y);
        #[rustfmt::skip]
        let jacobian = SMatrix::<f64, 2, 8>::from_row_slice(&[
            x, y, one, 0.0, 0.0, 0.0, -u * x, -u * y,
            0.0, 0.0, 0.0, x, y, one, -v * x, -v * y,
        ]);
        Some(jacobian)
    }

    fn normalised(&self, from: &Normalisation, to: &Normalisation) -> Option<Self> {
        self.with_matrix(to.matrix() * self.matrix * from.inverse_matrix())
    }

    fn denormalised(&self, from: &Normalisation, to: &Normalisation) -> Option<Self> {
        self.with_matrix(to.inverse_matrix() * self.matrix * from.matrix())
    }

    fn matrix(&self) -> Matrix3<f64> {
        self.matrix
    }
}

/// Fits homographies for [`crate::geometry::ransac::Ransac`].
#[derive(Debug, Clone, Copy)]
pub struct HomographyEstimator {
    /// Three points of a sample are treated as collinear if their triangle is smaller than this, square pixels.
    pub min_triangle_px2: f64,
}

impl Default for HomographyEstimator {
    fn default() -> Self {
        Self {
            min_triangle_px2: 32.0,
        }
    }
}

impl Estimator for HomographyEstimator {
    type Model = Homography;
    const SAMPLE_SIZE: usize = 4;

    fn fit_sample(&self, sample: &[Correspondence]) -> Option<Homography> {
        let sample: &[Correspondence; 4] = sample.try_into().ok()?;
        for skipped in 0..4 {
            let [a, b, c] = [1, 2, 3].map(|step| &sample[(skipped + step) % 4]);
            let from = doubled_area(a.from, b.from, c.from);
            let to = doubled_area(a.to, b.to, c.to);
            // Collinear or repeated points, or a triangle that is mirrored, which no view of the ground from above does.
            if from.abs().min(to.abs()) < 2.0 * self.min_triangle_px2
                || from.signum() != to.signum()
            {
                return None;
            }
        }
        Homography::through(sample).filter(|model| model.keeps_sides(sample))
    }

    fn fit_all(&self, pairs: &[Correspondence]) -> Option<Homography> {
        Homography::fit(pairs)
    }

    fn squared_error(&self, model: &Homography, pair: &Correspondence) -> f64 {
        model.squared_error(pair.from, pair.to)
    }
}
