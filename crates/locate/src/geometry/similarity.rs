//! Similarity transform: rotation, uniform scale, translation. With four degrees of freedom it degenerates less than a homography
//! with eight, and it nearly explains a nadir photo that was resampled to the resolution of the map.

use nalgebra::{Matrix2x4, Matrix3, Point2, Vector4};

use crate::geometry::{
    correspondence::{Correspondence, Normalisation},
    ransac::Estimator,
    scale_prior::ScalePrior,
    transform::Transform,
};

/// `(x, y) -> (a x - b y + tx, b x + a y + ty)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Scale times cosine of the rotation.
    pub a: f64,
    /// Scale times sine of the rotation, from x towards y.
    pub b: f64,
    /// Translation along x, pixels.
    pub tx: f64,
    /// Translation along y, pixels.
    pub ty: f64,
}

impl Similarity {
    /// Pixels of the picture mapped to, per pixel of the picture mapped from.
    pub fn scale(&self) -> f64 {
        // Near one, so that squares neither overflow nor vanish; `hypot` takes five times as long, once for each sample of RANSAC.
        (self.a * self.a + self.b * self.b).sqrt()
    }

    /// Rotation from x towards y (clockwise on a screen), radians.
    pub fn rotation_rad(&self) -> f64 {
        self.b.atan2(self.a)
    }

    /// The similarity of least weighted squared error over `pairs`; `None` for fewer than two distinct points.
    pub fn fit(pairs: &[Correspondence]) -> Option<Self> {
        let total: f64 = pairs.iter().map(|pair| pair.weight).sum();
        if pairs.len() < 2 || !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mean = |of: fn(&Correspondence) -> Point2<f64>| {
            pairs.iter().fold(nalgebra::Vector2::zeros(), |sum, pair| {
                sum + of(pair).coords * pair.weight
            }) / total
        };
        let (from, to) = (mean(|pair| pair.from), mean(|pair| pair.to));
        let (mut dot, mut cross, mut squares) = (0.0, 0.0, 0.0);
        for pair in pairs {
            let (p, q) = (pair.from.coords - from, pair.to.coords - to);
            dot += pair.weight * p.dot(&q);
            cross += pair.weight * p.perp(&q);
            squares += pair.weight * p.norm_squared();
        }
        if !(squares > 1e-12 * total) {
            return None;
        }
        let (a, b) = (dot / squares, cross / squares);
        let model = Self {
            a,
            b,
            tx: to.x - a * from.x + b * from.y,
            ty: to.y - b * from.x - a * from.y,
        };
        (model.parameters().iter().all(|value| value.is_finite()) && model.scale() > 1e-9)
            .then_some(model)
    }
}

impl Transform<4> for Similarity {
    fn parameters(&self) -> Vector4<f64> {
        Vector4::new(self.a, self.b, self.tx, self.ty)
    }

    fn with_parameters(&self, p: &Vector4<f64>) -> Self {
        Self {
            a: p[0],
            b: p[1],
            tx: p[2],
            ty: p[3],
        }
    }

    fn map(&self, p: Point2<f64>) -> Option<Point2<f64>> {
        Some(Point2::new(
            self.a * p.x - self.b * p.y + self.tx,
            self.b * p.x + self.a * p.y + self.ty,
        ))
    }

    fn parameter_jacobian(&self, p: Point2<f64>) -> Option<Matrix2x4<f64>> {
        Some(Matrix2x4::new(p.x, -p.y, 1.0, 0.0, p.y, p.x, 0.0, 1.0))
    }

    fn normalised(&self, from: &Normalisation, to: &Normalisation) -> Option<Self> {
        Some(similarity_of(
            &(to.matrix() * self.matrix() * from.inverse_matrix()),
        ))
    }

    fn denormalised(&self, from: &Normalisation, to: &Normalisation) -> Option<Self> {
        Some(similarity_of(
            &(to.inverse_matrix() * self.matrix() * from.matrix()),
        ))
    }

    fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(
            self.a, -self.b, self.tx, self.b, self.a, self.ty, 0.0, 0.0, 1.0,
        )
    }
}

fn similarity_of(m: &Matrix3<f64>) -> Similarity {
    Similarity {
        a: m[(0, 0)],
        b: m[(1, 0)],
        tx: m[(0, 2)],
        ty: m[(1, 2)],
    }
}

/// Fits similarities for [`crate::geometry::ransac::Ransac`].
#[derive(Debug, Clone, Copy)]
pub struct SimilarityEstimator {
    /// Smallest and largest allowed scale; samples outside are rejected before they are scored.
    pub scale_range: (f64, f64),
    /// Samples with points closer than this are rejected: they determine neither rotation nor scale, pixels.
    pub min_distance_px: f64,
    /// Largest allowed rotation in either direction, radians.
    pub max_rotation_rad: f64,
    /// How probable the scales are; `None` if all are alike.
    pub scale_prior: Option<ScalePrior>,
}

impl Default for SimilarityEstimator {
    fn default() -> Self {
        Self {
            scale_range: (0.0, f64::INFINITY),
            min_distance_px: 8.0,
            max_rotation_rad: f64::INFINITY,
            scale_prior: None,
        }
    }
}

impl Estimator for SimilarityEstimator {
    type Model = Similarity;
    const SAMPLE_SIZE: usize = 2;

    fn fit_sample(&self, sample: &[Correspondence]) -> Option<Similarity> {
        let [first, second] = sample else { return None };
        let (p, q) = (second.from - first.from, second.to - first.to);
        if p.norm() < self.min_distance_px || q.norm() < self.min_distance_px {
            return None;
        }
        let squared = p.norm_squared();
        let (a, b) = (p.dot(&q) / squared, p.perp(&q) / squared);
        let (from, to) = (first.from, first.to);
        let model = Similarity {
            a,
            b,
            tx: to.x - a * from.x + b * from.y,
            ty: to.y - b * from.x - a * from.y,
        };
        self.accepts(&model).then_some(model)
    }

    fn fit_all(&self, pairs: &[Correspondence]) -> Option<Similarity> {
        Similarity::fit(pairs).filter(|model| self.accepts(model))
    }

    fn squared_error(&self, model: &Similarity, pair: &Correspondence) -> f64 {
        model.squared_error(pair.from, pair.to)
    }

    fn prior_weight(&self, model: &Similarity) -> f64 {
        self.scale_prior
            .map_or(1.0, |prior| prior.inlier_weight(model.scale()))
    }
}

impl SimilarityEstimator {
    fn accepts(&self, model: &Similarity) -> bool {
        (self.scale_range.0..=self.scale_range.1).contains(&model.scale())
            && model.rotation_rad().abs() <= self.max_rotation_rad
    }
}
