//! One photo's answer as it is written. Scripts rely on the field names: they must not change.

use std::collections::BTreeMap;

use grimnet_locate::{EvidenceUsed, Outcome, Reason, TimeMs};
use grimnet_photo::Evidence;
use serde::{Deserialize, Serialize};

use crate::antimeridian::beside;
use crate::rounding::{rounded, rounded_heading};

/// Fewest corners that enclose an area.
const MIN_CORNERS: usize = 3;

/// One answer; without a fix the numbers are `null`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(default)]
pub struct Answer {
    /// The photo's path as given.
    pub photo: String,
    /// `fix` or `no_fix`.
    pub state: State,
    /// Latitude of the image centre, degrees, WGS 84.
    pub lat_deg: Option<f64>,
    /// Longitude of the image centre, degrees, WGS 84.
    pub lon_deg: Option<f64>,
    /// Direction of the photo's top edge, degrees clockwise from true north.
    pub heading_deg: Option<f64>,
    /// Ground resolution of the full-size photo, metres per pixel.
    pub gsd_m: Option<f64>,
    /// Radius in metres that should hold the truth in 95 % of cases.
    pub radius95_m: Option<f64>,
    /// Covariance in square metres: east-east, east-north, north-north.
    pub covariance_en_m2: Option<[f64; 3]>,
    /// Probability that the position is right and not another place; `null` if the model was not calibrated.
    pub confidence: Option<f64>,
    /// Matches that agree with the transform.
    pub inliers: Option<usize>,
    /// Why there is no fix.
    pub reason: Option<String>,
    /// Whether the photo's file is damaged or ends early.
    pub damaged: bool,
    /// Milliseconds by stage, and `total`.
    pub time_ms: BTreeMap<String, f64>,
    /// Mutual matches before geometric verification.
    pub matches: Option<usize>,
    /// Inliers of the best candidate at another place.
    pub runner_up_inliers: Option<usize>,
    /// Distance in metres from the position in the photo's own metadata (`--check`).
    pub check_m: Option<f64>,
    /// Corners of the photo on the ground, `[lon, lat]` in degrees, clockwise from the top left; `null` if fewer than three are known.
    pub outline_lon_lat_deg: Option<Vec<[f64; 2]>>,
    /// Metadata and options that were used.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<EvidenceSchema>))]
    pub used: Vec<Evidence>,
    /// Metadata that were not used, with the reason.
    #[cfg_attr(feature = "schema", schema(value_type = Vec<EvidenceSchema>))]
    pub set_aside: Vec<Evidence>,
    /// Assumptions about heading and scale if nothing was known.
    pub assumed: Option<String>,
}

/// One metadata field or prior value, and why it was used or not: [`Evidence`] for the schema.
#[cfg(feature = "schema")]
#[derive(utoipa::ToSchema)]
#[schema(as = Evidence)]
#[allow(dead_code, reason = "describes Evidence of grimnet-photo")]
pub(crate) struct EvidenceSchema {
    /// The field as its source names it, such as `GimbalYawDegree`.
    field: String,
    /// Its value as read, with the unit.
    value: String,
    /// The reason.
    reason: String,
}

/// Whether there is an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// A position is given.
    Fix,
    /// No position is given, and `reason` says why.
    #[default]
    NoFix,
}

impl Answer {
    /// An answer without a fix.
    #[must_use]
    pub fn no_fix(photo: &str, reason: impl std::fmt::Display) -> Self {
        Self {
            photo: photo.to_owned(),
            reason: Some(reason.to_string()),
            ..Self::default()
        }
    }

    /// The answer for `photo` from the result of the localiser.
    #[must_use]
    pub fn of(photo: &str, outcome: &Outcome) -> Self {
        match outcome {
            Outcome::Fix(fix) => Self {
                state: State::Fix,
                lat_deg: Some(rounded(fix.lat_deg, 8)),
                lon_deg: Some(rounded(fix.lon_deg, 8)),
                heading_deg: fix.heading_deg.map(|degrees| rounded_heading(degrees, 2)),
                gsd_m: Some(rounded(fix.gsd_m, 6)),
                radius95_m: Some(rounded(fix.radius95_m, 3)),
                covariance_en_m2: Some(fix.covariance_en_m2.map(|v| rounded(v, 6))),
                confidence: fix.confidence.map(|v| rounded(v, 6)),
                inliers: Some(fix.inliers),
                matches: Some(fix.matches),
                runner_up_inliers: fix.runner_up.map(|r| r.inliers),
                outline_lon_lat_deg: (fix.outline_lon_lat_deg.len() >= MIN_CORNERS).then(|| {
                    let corners = fix.outline_lon_lat_deg.iter();
                    corners
                        .map(|corner| corner.map(|v| rounded(v, 8)))
                        .collect()
                }),
                ..Self::of_photo(photo, &fix.evidence, &fix.time_ms)
            },
            Outcome::NoFix(no_fix) => Self {
                reason: Some(no_fix.reason.to_string()),
                damaged: matches!(no_fix.reason, Reason::DamagedPhoto { .. }),
                inliers: Some(no_fix.inliers),
                matches: Some(no_fix.matches),
                ..Self::of_photo(photo, &no_fix.evidence, &no_fix.time_ms)
            },
        }
    }

    /// The outline as a ring that is not closed, counter-clockwise as RFC 7946 (3.1.6) has it, on the same side of the antimeridian as the
    /// position: its longitudes may be beyond 180 or -180 degrees.
    pub(crate) fn outline_ring(&self) -> Option<Vec<[f64; 2]>> {
        let centre_lon_deg = self.lon_deg?;
        let (first, rest) = self.outline_lon_lat_deg.as_ref()?.split_first()?;
        let corners = std::iter::once(first).chain(rest.iter().rev());
        let on_one_side = corners.map(|&[lon, lat]| [beside(lon, centre_lon_deg), lat]);
        Some(on_one_side.collect())
    }

    /// What fixes and refusals have in common.
    fn of_photo(photo: &str, evidence: &EvidenceUsed, time_ms: &TimeMs) -> Self {
        Self {
            photo: photo.to_owned(),
            time_ms: time_ms
                .stages()
                .map(|(name, ms)| (name.to_owned(), rounded(ms, 3)))
                .into(),
            used: evidence.used.clone(),
            set_aside: evidence.set_aside.clone(),
            assumed: evidence.assumed.clone(),
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use grimnet_locate::{Fix, Support, TileRef};

    use super::*;

    fn answer_with(outline_lon_lat_deg: Vec<[f64; 2]>) -> Answer {
        let fix = Fix {
            lat_deg: 24.0,
            lon_deg: 120.0,
            heading_deg: None,
            gsd_m: 0.1,
            covariance_en_m2: [1.0, 0.0, 1.0],
            radius95_m: 2.5,
            confidence: None,
            support: Support {
                inliers: 60,
                places: 40,
                matches: 90,
                runner_up_inliers: 5,
                spread: 0.5,
                expected_inliers: 0.5,
                held_back_points: 200,
                held_back_excess: 0.2,
                on_map: 1.0,
                inlier_covariance_en_m2: [1.0, 0.0, 1.0],
            },
            inliers: 60,
            matches: 90,
            tile: TileRef {
                level: 0,
                gsd_m: 0.3,
                index: 0,
                similarity: 0.5,
                votes: 20,
            },
            runner_up: None,
            outline_lon_lat_deg,
            evidence: EvidenceUsed::default(),
            time_ms: TimeMs::default(),
            drawn: None,
        };
        Answer::of("a.jpg", &Outcome::Fix(Box::new(fix)))
    }

    #[test]
    fn an_outline_has_three_corners_at_least() {
        let corners = vec![
            [119.9, 24.1],
            [120.1, 24.1],
            [120.1, 23.9],
            [119.900_000_000_1, 23.9],
        ];
        for count in 0..3 {
            let answer = answer_with(corners[..count].to_vec());
            assert_eq!(answer.outline_lon_lat_deg, None, "{count} corners");
        }
        let three = answer_with(corners[..3].to_vec());
        assert_eq!(three.outline_lon_lat_deg.as_deref(), Some(&corners[..3]));
        let whole = answer_with(corners).outline_lon_lat_deg.unwrap();
        assert_eq!(whole[3], [119.9, 23.9], "rounded to 8 decimals");
    }
}
