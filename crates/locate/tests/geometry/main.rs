//! Geometry and matching against OpenCV (golden/make_golden.py) and against properties that hold for any input.

#![allow(clippy::unwrap_used)]

mod estimation;
mod matching;
use grimnet_kernels::Isa;
use grimnet_locate::internals::{
    correspondence::Correspondence,
    homography::{Homography, HomographyEstimator},
    matching::{Descriptors, Matcher},
    ransac::{Estimate, Estimator, Ransac, Score},
    refine::refine,
    sampler::{Progressive, Uniform},
    scale_prior::ScalePrior,
    similarity::{Similarity, SimilarityEstimator},
    transform::Transform,
};
use nalgebra::{Matrix3, Point2};
use proptest::prelude::*;
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    cases: Vec<Case>,
    matching: Matching,
}

#[derive(Deserialize)]
struct Case {
    kind: String,
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    inliers: Vec<usize>,
    opencv_least_squares: Option<[[f64; 3]; 3]>,
    opencv_ransac: [[f64; 3]; 3],
    opencv_inliers: Vec<usize>,
}

#[derive(Deserialize)]
struct Matching {
    dim: usize,
    query: Vec<f32>,
    tile: Vec<f32>,
    mutual: Vec<(u32, u32)>,
    #[serde(rename = "mutual_ratio_0.8")]
    mutual_ratio: Vec<(u32, u32)>,
}

impl Case {
    fn pairs(&self) -> Vec<Correspondence> {
        self.from
            .iter()
            .zip(&self.to)
            .map(|(&a, &b)| Correspondence::new(Point2::from(a), Point2::from(b)))
            .collect()
    }
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../golden/geometry.json")).unwrap()
}

fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows[row][column])
}

fn choose(pairs: &[Correspondence], indices: &[usize]) -> Vec<Correspondence> {
    indices.iter().map(|&index| pairs[index]).collect()
}
