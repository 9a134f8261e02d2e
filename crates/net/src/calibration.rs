//! Calibration of a model's stated covariance and confidence: fitted to answers whose truth is known, and stored in the
//! model file, because the errors depend on the weights.

use serde::{Deserialize, Serialize};

use crate::error::CalibrationError;

/// Largest factor or weight that is accepted: far beyond any fit, small enough that no result overflows.
const LARGEST: f64 = 1e6;

/// What `grim calibrate` fitted to a model's answers. A model file without it has [`Calibration::default`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Calibration {
    /// From the covariance of the inliers to the covariance that is stated.
    pub position: PositionError,
    /// From the support of a fix to the probability that it is right; `None` if it was never fitted.
    pub confidence: Option<Confidence>,
    /// What it was fitted to; `None` for the built-in default.
    pub fitted_on: Option<FittedOn>,
}

impl Calibration {
    /// Checks that every number is finite and within the range that gives finite, positive covariances and probabilities.
    ///
    /// # Errors
    /// [`CalibrationError`] with the first field that is out of range.
    pub fn validate(&self) -> Result<(), CalibrationError> {
        self.position.validate()?;
        self.confidence.map_or(Ok(()), |c| c.validate())?;
        self.fitted_on.as_ref().map_or(Ok(()), FittedOn::validate)
    }
}

/// Checks that `found` lies in a range, which no NaN does.
fn within(
    field: &'static str,
    found: f64,
    range: impl std::ops::RangeBounds<f64>,
    expected: &'static str,
) -> Result<(), CalibrationError> {
    if range.contains(&found) {
        Ok(())
    } else {
        Err(CalibrationError {
            field,
            found,
            expected,
        })
    }
}

/// Stated covariance = `inlier_factor` x covariance of the inliers + `shared_px`^2 per axis, in pixels of the map's level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PositionError {
    /// Factor on the covariance of the inliers: their errors are correlated, and weighted least squares assumes they are
    /// not. Greater than 0.
    pub inlier_factor: f64,
    /// Error that all inliers share (parallax, blur, shifted keypoints), 1-sigma per axis, pixels of the level. Greater
    /// than 0.
    pub shared_px: f64,
}

impl Default for PositionError {
    /// Set by hand, not fitted: rounded values found with the first models.
    fn default() -> Self {
        Self {
            inlier_factor: 4.0,
            shared_px: 1.0,
        }
    }
}

impl PositionError {
    fn validate(&self) -> Result<(), CalibrationError> {
        let range = || {
            (
                std::ops::Bound::Excluded(0.0),
                std::ops::Bound::Included(LARGEST),
            )
        };
        let expected = "greater than 0 and at most 1e6";
        within("inlier_factor", self.inlier_factor, range(), expected)?;
        within("shared_px", self.shared_px, range(), expected)
    }
}

/// Logistic model (Cox 1958) of the probability that a fix is right: `1 / (1 + exp(-(intercept + weights . evidence)))`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Confidence {
    /// Log odds if all evidence is zero.
    pub intercept: f64,
    /// Weight of the natural logarithm of the number of cells of the photo that hold inliers.
    pub log_places: f64,
    /// Weight of the natural logarithm of the ratio of inliers to the runner-up's inliers (at least ten: chance gives as
    /// many).
    pub log_lead: f64,
    /// Weight of the natural logarithm of the ratio of inliers to those that guided matching finds by chance.
    pub log_excess: f64,
    /// Weight of the natural logarithm of the inliers' spread over the photo (short axis, in half sides).
    pub log_spread: f64,
    /// Weight of the mean excess of similarity of the map's keypoints that are not inliers; 0 in models that were calibrated
    /// without it.
    #[serde(default)]
    pub held_back: f64,
    /// Fixes of a lower probability are rejected. By the fit, only a small share of photos taken elsewhere (one in a
    /// thousand, unless set otherwise) reaches it. Greater than 0, at most 1.
    pub needed: f64,
}

impl Confidence {
    fn validate(&self) -> Result<(), CalibrationError> {
        let weights = [
            ("intercept", self.intercept),
            ("log_places", self.log_places),
            ("log_lead", self.log_lead),
            ("log_excess", self.log_excess),
            ("log_spread", self.log_spread),
            ("held_back", self.held_back),
        ];
        for (field, found) in weights {
            within(field, found, -LARGEST..=LARGEST, "between -1e6 and 1e6")?;
        }
        let range = (
            std::ops::Bound::Excluded(0.0),
            std::ops::Bound::Included(1.0),
        );
        within("needed", self.needed, range, "greater than 0 and at most 1")
    }
}

/// The data that a calibration was fitted to, and what it reached on held-out photos.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct FittedOn {
    /// Description of the data.
    pub data: String,
    /// Trials with photos that lie on their map: one photo may be tried with its heading known and unknown.
    pub photos: usize,
    /// Right fixes to which the covariance was fitted; 0 if it was not.
    pub fixes: usize,
    /// Trials with photos that lie elsewhere, which must have no fix.
    pub elsewhere: usize,
    /// Share of right fixes within their stated 95 % radius, on photos held out of the fit.
    pub held_out_coverage_95: f64,
    /// Share of held-out photos that lie on their map and have a fix.
    pub held_out_availability: f64,
    /// Photos that lie elsewhere and were held out of the fit.
    pub held_out_elsewhere: usize,
    /// Those of them that were given a fix nevertheless.
    pub held_out_elsewhere_answered: usize,
}

impl FittedOn {
    fn validate(&self) -> Result<(), CalibrationError> {
        for (field, found) in [
            ("held_out_coverage_95", self.held_out_coverage_95),
            ("held_out_availability", self.held_out_availability),
        ] {
            within(field, found, 0.0..=1.0, "between 0 and 1")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted() -> Calibration {
        Calibration {
            confidence: Some(Confidence {
                intercept: -2.8,
                log_places: 3.3,
                log_lead: 2.3,
                log_excess: 2.8,
                log_spread: 2.5,
                held_back: 27.0,
                needed: 0.9,
            }),
            fitted_on: Some(FittedOn::default()),
            ..Calibration::default()
        }
    }

    #[test]
    fn values_that_give_no_covariance_or_probability_are_refused() {
        fitted().validate().unwrap();
        Calibration::default().validate().unwrap();
        type Change = fn(&mut Calibration, f64);
        let positive: [(&str, Change); 2] = [
            ("inlier_factor", |c, v| c.position.inlier_factor = v),
            ("shared_px", |c, v| c.position.shared_px = v),
        ];
        let weights: [(&str, Change); 2] = [
            ("log_lead", |c, v| {
                c.confidence.as_mut().unwrap().log_lead = v
            }),
            ("intercept", |c, v| {
                c.confidence.as_mut().unwrap().intercept = v
            }),
        ];
        let needed: [(&str, Change); 1] =
            [("needed", |c, v| c.confidence.as_mut().unwrap().needed = v)];
        let shares: [(&str, Change); 1] = [("held_out_availability", |c, v| {
            c.fitted_on.as_mut().unwrap().held_out_availability = v;
        })];
        let never = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300];
        let cases = [
            (&positive[..], &[0.0, -0.0, -1.0][..]),
            (&weights[..], &[-1e7][..]),
            (&needed[..], &[0.0, -0.5, 1.1][..]),
            (&shares[..], &[-0.1, 1.1][..]),
        ];
        for (fields, values) in cases {
            for (field, change) in fields {
                for &value in never.iter().chain(values) {
                    let mut calibration = fitted();
                    change(&mut calibration, value);
                    let error = calibration.validate().unwrap_err();
                    assert_eq!(error.field, *field, "{value}");
                }
            }
        }
    }
}
