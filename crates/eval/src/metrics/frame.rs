//! How one photo was answered, compared with its truth.

use std::collections::BTreeMap;

use grimnet_geo::{LonLat, distance_m, offset_en_m};
use grimnet_locate::Fix;
use grimnet_locate::internals::covariance::radius;
use nalgebra::Matrix2;
use serde::Serialize;

/// How one photo was answered, compared with its truth.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Frame {
    /// File name of the photo.
    pub photo: String,
    /// Whether a fix was given.
    pub fixed: bool,
    /// The fix as it was stated.
    #[serde(skip)]
    pub stated: Option<ScoredFix>,
    /// The true position of the image centre, if it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<LonLat>,
    /// Distance from the true position in metres; `None` without a fix.
    pub error_m: Option<f64>,
    /// Error east of the truth in metres.
    pub error_east_m: Option<f64>,
    /// Error north of the truth in metres.
    pub error_north_m: Option<f64>,
    /// Stated radius that contains the truth in 95 % of cases, metres.
    pub radius95_m: Option<f64>,
    /// Squared Mahalanobis distance of the error under the stated covariance (chi-square, 2 degrees of freedom).
    pub mahalanobis2: Option<f64>,
    /// Stated radius that contains the truth in 50 % of cases, metres.
    pub radius50_m: Option<f64>,
    /// Stated radius that contains the truth in 90 % of cases, metres.
    pub radius90_m: Option<f64>,
    /// Stated 95 % radius enlarged by the error of the truth, metres ([`Frame::with_truth_error`]).
    pub radius95_with_truth_m: Option<f64>,
    /// Whether the position of the satellite receiver is known.
    #[serde(skip)]
    pub has_receiver: bool,
    /// Distance from the satellite receiver, metres, if its position is known.
    pub gps_error_m: Option<f64>,
    /// Stated probability that the fix is right.
    pub confidence: Option<f64>,
    /// Matches that are consistent with the answer.
    pub inliers: Option<usize>,
    /// Why there is no fix.
    pub reason: Option<String>,
    /// Time from decoded photo to answer, milliseconds.
    pub time_ms: Option<f64>,
    /// Ground width of the photo that was given, metres: what is right is a share of it.
    pub footprint_width_m: Option<f64>,
    /// Ground width of the photo by what was given, by its metadata or by its fix, metres: which photos show the same ground.
    #[serde(skip)]
    pub shown_width_m: Option<f64>,
    /// Standard deviation of the true position, metres per axis, if it is known.
    pub truth_error_m: Option<f64>,
    /// Name of the place that the photo shows.
    pub place: Option<String>,
    /// Whether the photo has enough features to be localised; `None` if that is not known.
    pub answerable: Option<bool>,
    /// Angle between the camera's axis and straight down, degrees, if it is known.
    pub tilt_deg: Option<f64>,
    /// Time of each stage, milliseconds.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub stage_ms: BTreeMap<String, f64>,
}

/// The part of a fix that is scored: position and stated uncertainty.
#[derive(Debug, Clone, Copy)]
pub struct ScoredFix {
    /// The stated position.
    pub position: LonLat,
    /// Stated covariance in square metres: east-east, east-north, north-north.
    pub covariance_en_m2: [f64; 3],
    /// Stated 95 % radius in metres.
    pub radius95_m: f64,
}

impl ScoredFix {
    /// Position and uncertainty of a fix, rounded as the program writes them, so that figures agree with written answers.
    #[must_use]
    pub fn of(fix: &Fix) -> Self {
        Self {
            position: LonLat {
                lon_deg: rounded(fix.lon_deg, 8),
                lat_deg: rounded(fix.lat_deg, 8),
            },
            covariance_en_m2: fix.covariance_en_m2.map(|value| rounded(value, 6)),
            radius95_m: rounded(fix.radius95_m, 3),
        }
    }
}

/// A value to so many decimals: 8 of a degree are a millimetre.
pub(crate) fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    (value * scale).round() / scale
}

impl Frame {
    /// Compares one fix with the true position.
    #[must_use]
    pub fn score(photo: &str, fix: &ScoredFix, truth: LonLat) -> Self {
        let (east, north) = offset_en_m(truth, fix.position);
        let [ee, en, nn] = fix.covariance_en_m2;
        let covariance = Matrix2::new(ee, en, en, nn);
        let determinant = ee * nn - en * en;
        let mahalanobis2 =
            (nn * east * east - 2.0 * en * east * north + ee * north * north) / determinant;
        Self {
            photo: photo.to_owned(),
            fixed: true,
            stated: Some(*fix),
            error_m: Some(east.hypot(north)),
            error_east_m: Some(east),
            error_north_m: Some(north),
            radius95_m: Some(fix.radius95_m),
            radius50_m: Some(radius(&covariance, 0.5)),
            radius90_m: Some(radius(&covariance, 0.9)),
            mahalanobis2: (determinant > 0.0).then_some(mahalanobis2),
            ..Self::default()
        }
    }

    /// The same, with a standard deviation of the truth of `sigma_m` metres per axis added to the stated covariance.
    #[must_use]
    pub fn with_truth_error(self, fix: &ScoredFix, sigma_m: f64) -> Self {
        let [ee, en, nn] = fix.covariance_en_m2;
        let covariance = Matrix2::new(ee, en, en, nn) + Matrix2::identity() * sigma_m.powi(2);
        Self {
            radius95_with_truth_m: Some(radius(&covariance, 0.95)),
            truth_error_m: Some(sigma_m),
            ..self
        }
    }

    /// The same, with the distance from the satellite receiver.
    #[must_use]
    pub fn with_gps(self, fix: &ScoredFix, gps: LonLat) -> Self {
        Self {
            gps_error_m: Some(distance_m(gps, fix.position)),
            ..self
        }
    }

    /// A photo without a fix.
    #[must_use]
    pub fn missed(photo: &str, reason: &str) -> Self {
        Self {
            photo: photo.to_owned(),
            reason: Some(reason.to_owned()),
            ..Self::default()
        }
    }

    /// Error as a share of the ground width of the photo; `None` without a fix or if the width is not known.
    #[must_use]
    pub fn footprint_share(&self) -> Option<f64> {
        Some(self.error_m? / self.footprint_width_m?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn an_error_is_split_into_east_and_north_and_weighted_by_its_covariance() {
        let truth = LonLat {
            lon_deg: 0.0,
            lat_deg: 0.0,
        };
        // One arc second of latitude at the equator is 30.715 m (WGS 84).
        let fix = ScoredFix {
            position: LonLat {
                lon_deg: 0.0,
                lat_deg: 1.0 / 3600.0,
            },
            covariance_en_m2: [1.0, 0.0, 100.0],
            radius95_m: 20.0,
        };
        let scored = Frame::score("a.jpg", &fix, truth);
        assert_relative_eq!(scored.error_m.unwrap(), 30.715, epsilon = 1e-2);
        assert_relative_eq!(scored.error_north_m.unwrap(), 30.715, epsilon = 1e-2);
        assert_relative_eq!(scored.mahalanobis2.unwrap(), 9.434, epsilon = 1e-2);
    }

    #[test]
    fn an_error_is_a_share_of_the_footprint_where_that_is_known() {
        let frame = |error_m, footprint_width_m| Frame {
            error_m,
            footprint_width_m,
            ..Frame::default()
        };
        assert_eq!(frame(Some(8.0), Some(160.0)).footprint_share(), Some(0.05));
        assert_eq!(frame(None, Some(160.0)).footprint_share(), None);
        assert_eq!(frame(Some(8.0), None).footprint_share(), None);
    }
}
