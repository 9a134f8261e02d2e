//! Plane geometry between two pictures, in pixels: transforms, their estimation from matched points, and their covariance.
//!
//! Nothing here knows of maps, metres or degrees.

pub mod correspondence;
pub mod covariance;
pub mod distribution;
pub mod estimation;
pub mod homography;
pub mod plain_homography;
pub mod ransac;
pub mod refine;
pub mod sampler;
pub mod scale_prior;
pub mod similarity;
pub mod transform;
