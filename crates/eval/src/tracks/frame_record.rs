//! What one rendered frame gave, compared with the truth.

use grimnet_track::simulation::FixSample;
use serde::{Deserialize, Serialize};

use super::ground_cover::Cover;

/// A frame of a rendered flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Exposure time, seconds.
    pub time_s: f64,
    /// What covers the ground; `None` over town and country.
    pub cover: Option<Cover>,
    /// Whether the search was by windows of the filter alone.
    pub tracked: bool,
    /// The fix; `None` without one.
    pub fix: Option<MeasuredFix>,
    /// The motion from the frame before; `None` without one.
    pub motion: Option<MeasuredMotion>,
    /// Wall time of search and motion, without rendering, milliseconds.
    pub time_ms: f64,
}

/// A fix compared with the truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeasuredFix {
    /// The fix and its error.
    pub sample: FixSample,
    /// Distance of the fix from the true image centre on the map, metres.
    pub error_m: f64,
    /// What of its error comes from the height of the surface that was matched, as its ground resolution shows, metres east and
    /// north: a tilted view meets roofs before the ground.
    #[serde(skip)]
    pub relief_en_m: [f64; 2],
}

impl MeasuredFix {
    /// The fix as simulated flights draw it again, over a surface of the same height under another tilt.
    #[must_use]
    pub fn without_relief(&self) -> FixSample {
        let [east_m, north_m] = self.sample.error_en_m;
        FixSample {
            error_en_m: [east_m - self.relief_en_m[0], north_m - self.relief_en_m[1]],
            ..self.sample
        }
    }

    /// Squared Mahalanobis distance: chi-square with two degrees of freedom if the covariance is right. `None` if it is
    /// singular.
    #[must_use]
    pub fn nees(&self) -> Option<f64> {
        let [ee, en, nn] = self.sample.covariance_en_m2;
        let [east, north] = self.sample.error_en_m;
        let determinant = ee * nn - en * en;
        (determinant > 0.0).then(|| {
            (nn * east * east - 2.0 * en * east * north + ee * north * north) / determinant
        })
    }

    /// Whether it is of another place: further off than 25 m and than five of its own standard deviations.
    #[must_use]
    pub fn is_wrong(&self) -> bool {
        self.error_m > 25.0 && self.nees().is_none_or(|nees| nees > 25.0)
    }
}

/// A motion between frames compared with the truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeasuredMotion {
    /// Distance flown between the frames, metres.
    pub distance_m: f64,
    /// Distance between the measured and the true displacement, metres.
    pub error_m: f64,
    /// Stated standard deviation per axis without the part that is relative to the distance, metres.
    pub sigma_m: f64,
    /// Error of the turn, degrees.
    pub turn_error_deg: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn a_wrong_fix_is_far_off_in_metres_and_in_deviations() {
        let fix = |error_m: f64, variance_m2: f64| MeasuredFix {
            sample: FixSample {
                error_en_m: [error_m, 0.0],
                covariance_en_m2: [variance_m2, 0.0, variance_m2],
                confidence: 0.9,
                heading_error_deg: 0.0,
                gsd_ratio: 1.0,
            },
            error_m,
            relief_en_m: [0.0; 2],
        };
        assert_relative_eq!(fix(3.0, 4.0).nees().unwrap(), 2.25);
        assert!(fix(40.0, 1.0).is_wrong());
        assert!(!fix(10.0, 1.0).is_wrong());
        assert!(!fix(40.0, 400.0).is_wrong());
    }
}
