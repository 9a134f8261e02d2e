//! How far the answers of a model may be off, and how often they are wrong: fitted on answers whose truth is known, and kept
//! with the model, for other weights err differently.

use serde::{Deserialize, Serialize};

/// What `grim calibrate` found out about a model's answers. A model file without one has [`Calibration::default`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Calibration {
    /// From the covariance of the inliers to the covariance that is stated.
    pub position: PositionError,
    /// From the support of a fix to the probability that it is right; none where it was never fitted.
    pub confidence: Option<Confidence>,
    /// What it was fitted on; none for the built-in default.
    pub fitted_on: Option<FittedOn>,
}

/// Stated covariance = `inlier_factor` x covariance of the inliers + `shared_px`^2 per axis, in pixels of the map's level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PositionError {
    /// The errors of neighbouring inliers are not independent, as weighted least squares takes them to be.
    pub inlier_factor: f64,
    /// What all inliers share (parallax, blur, shifted keypoints), 1-sigma per axis, pixels of the level.
    pub shared_px: f64,
}

impl Default for PositionError {
    /// Set by hand, not fitted: of round size, as found with the first models.
    fn default() -> Self {
        Self {
            inlier_factor: 4.0,
            shared_px: 1.0,
        }
    }
}

/// Logistic model (Cox 1958) of the probability that a fix is right: `1 / (1 + exp(-(intercept + weights . evidence)))`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Confidence {
    /// Log odds where all evidence is zero.
    pub intercept: f64,
    /// Per unit of the natural logarithm of the number of places of the photo that hold inliers.
    pub log_places: f64,
    /// Per unit of the natural logarithm of inliers over the runner-up's inliers (at least six: chance gives as many).
    pub log_lead: f64,
    /// Per unit of the natural logarithm of inliers over matches.
    pub log_share: f64,
    /// Per unit of the natural logarithm of the inliers' spread over the photo (short axis, in half sides).
    pub log_spread: f64,
    /// A fix below this is not given: by the fit, only a small share of photos taken elsewhere (one in a thousand, unless
    /// asked otherwise) comes above.
    pub needed: f64,
}

/// What a calibration rests on.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct FittedOn {
    /// In words.
    pub data: String,
    /// Photos that lie on their map.
    pub photos: usize,
    /// Right answers to them, which the covariance was fitted on.
    pub fixes: usize,
    /// Photos that lie elsewhere, which must have no fix.
    pub elsewhere: usize,
    /// Share of right answers within their stated 95 % radius, on photos held out of the fit.
    pub held_out_coverage_95: f64,
    /// Share of held-out photos that lie on their map and are answered.
    pub held_out_availability: f64,
    /// Photos that lie elsewhere and were held out of the fit.
    pub held_out_elsewhere: usize,
    /// Those of them that were given a fix nevertheless.
    pub held_out_elsewhere_answered: usize,
}
