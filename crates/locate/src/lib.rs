//! From a photo and a map pack to a fix: matching, homography, gates, the Localizer.
//!
//! The geometry knows pixels of two pictures only; metres and degrees come in with the facade.

// `!(x > limit)` is meant: a NaN must fail the check.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

pub mod correspondence;
pub mod covariance;
pub mod gates;
pub mod homography;
pub mod matching;
pub mod ransac;
pub mod refine;
pub mod sampler;
pub mod similarity;
pub mod transform;
pub mod vote;
