//! What is known of how a photo sees the ground, with the reasons.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::camera::{MAX_PITCH_FROM_NADIR_DEG, Tilt};
use crate::evidence::Evidence;

/// Prior knowledge of the heading: the bearing of the photo's top, degrees clockwise from true north.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadingPrior {
    /// The heading is known.
    Known {
        /// Degrees clockwise from true north.
        heading_deg: f64,
        /// 1-sigma, degrees.
        sigma_deg: f64,
    },
    /// The heading is taken from the photo's metadata; it is unknown if they do not have a plausible one.
    #[default]
    FromMetadata,
    /// The heading is unknown; metadata are ignored.
    Unknown,
}

/// Headings that are accepted, degrees: two turns either way, as programs that count on write them. Of a number that is much larger nothing
/// is left when whole turns are taken off.
pub const HEADING_RANGE_DEG: std::ops::RangeInclusive<f64> = -720.0..=720.0;

/// Pitches of the camera that are accepted, degrees: straight down is -90, and [`MAX_PITCH_FROM_NADIR_DEG`] to either side can be rectified.
pub const PITCH_RANGE_DEG: std::ops::RangeInclusive<f64> =
    -90.0 - MAX_PITCH_FROM_NADIR_DEG..=-90.0 + MAX_PITCH_FROM_NADIR_DEG;

/// Rolls of the camera that are accepted, degrees.
pub const ROLL_RANGE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;

/// Assumed 1-sigma of a heading that is given without one, degrees.
const GIVEN_HEADING_SIGMA_DEG: f64 = 5.0;

impl HeadingPrior {
    /// The same heading with this 1-sigma, degrees, in place of the assumed one; without one as it is.
    ///
    /// # Errors
    /// What is wrong and what was expected: the 1-sigma is out of range, or the heading is not known.
    pub fn with_sigma_deg(self, sigma_deg: Option<f64>) -> Result<Self, String> {
        match (self, sigma_deg) {
            (heading, None) => Ok(heading),
            (Self::Known { heading_deg, .. }, Some(sigma_deg))
                if sigma_deg > 0.0 && sigma_deg <= 180.0 =>
            {
                Ok(Self::Known {
                    heading_deg,
                    sigma_deg,
                })
            }
            (Self::Known { .. }, Some(sigma_deg)) => Err(format!(
                "heading_sigma_deg is {sigma_deg}; expected above 0 and up to 180 degrees"
            )),
            (_, Some(_)) => {
                Err("heading_sigma_deg is given without a heading in degrees".to_owned())
            }
        }
    }
}

/// `exif` (from metadata), `unknown`, or degrees clockwise from true north with an assumed 1-sigma of 5 degrees.
impl FromStr for HeadingPrior {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "exif" => Ok(Self::FromMetadata),
            "unknown" => Ok(Self::Unknown),
            _ => match text.parse::<f64>() {
                Ok(degrees) if HEADING_RANGE_DEG.contains(&degrees) => Ok(Self::Known {
                    heading_deg: degrees.rem_euclid(360.0),
                    sigma_deg: GIVEN_HEADING_SIGMA_DEG,
                }),
                _ => Err(
                    "expected degrees clockwise from north (-720 to 720), `exif` or `unknown`"
                        .to_owned(),
                ),
            },
        }
    }
}

/// Prior knowledge of a photo's view. Each value overrides the photo's metadata.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ViewPrior {
    /// Heading.
    pub heading: HeadingPrior,
    /// Pitch of the camera, degrees, as gimbals state it: -90 looks straight down, -60 towards the photo's top by 30 degrees, level from
    /// side to side if no roll is given.
    pub pitch_deg: Option<f64>,
    /// Turn of the camera about its optical axis, degrees, with the pitch ([`Tilt::roll_deg`]); 0 if it is not given.
    pub roll_deg: Option<f64>,
    /// Height above ground, m.
    pub height_agl_m: Option<f64>,
    /// Field of view across the photo's width, degrees.
    pub hfov_deg: Option<f64>,
    /// Ground metres per pixel of the photo at full size, at its centre.
    pub gsd_m: Option<f64>,
}

impl ViewPrior {
    /// The pitch that is given, if it is in [`PITCH_RANGE_DEG`].
    pub(crate) fn usable_pitch_deg(&self) -> Option<f64> {
        self.pitch_deg
            .filter(|pitch_deg| PITCH_RANGE_DEG.contains(pitch_deg))
    }
}

/// A heading with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Heading {
    /// Where the top of the (displayed) photo points, degrees clockwise from true north, 0 to 360.
    pub heading_deg: f64,
    /// 1-sigma, degrees.
    pub sigma_deg: f64,
}

/// A ground width with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Footprint {
    /// Ground width across the photo's centre, m.
    pub width_m: f64,
    /// Relative 1-sigma: 0.15 says 15 %.
    pub relative_sigma: f64,
}

impl Footprint {
    /// Whether the width is so uncertain that other widths should be tried: a fix may be at up to 1.35 times the stated scale
    /// (`max_scale_change` of `grimnet-locate`), which must be more than three sigma away.
    pub fn is_uncertain(&self) -> bool {
        self.relative_sigma > 0.1
    }

    /// Ground metres per pixel of a photo `width_px` wide.
    pub fn gsd_m(&self, width_px: u32) -> f64 {
        self.width_m / f64::from(width_px.max(1))
    }
}

/// Attitude of the camera, with the angles of drone metadata ([`Tilt`]).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraAttitude {
    /// Angle between the optical axis and straight down, degrees; positive looks ahead (DJI's gimbal pitch + 90).
    pub pitch_from_nadir_deg: f64,
    /// Turn about the optical axis, degrees.
    pub roll_deg: f64,
}

impl CameraAttitude {
    /// Pitch as gimbals state it, degrees: -90 looks straight down.
    pub fn gimbal_pitch_deg(&self) -> f64 {
        self.pitch_from_nadir_deg - 90.0
    }
}

/// What is known of how a photo sees the ground. Everything may be unknown; a localiser then searches.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct View {
    /// Where the photo's top points.
    pub heading: Option<Heading>,
    /// How much ground it covers.
    pub footprint: Option<Footprint>,
    /// Tilt of the camera if it is given or recorded and at least one degree; `None` is treated as straight down.
    pub tilt: Option<Tilt>,
    /// Attitude of the camera if it is given, or recorded and plausible, straight down included.
    pub attitude: Option<CameraAttitude>,
    /// Field of view across the displayed photo's width, degrees.
    pub hfov_deg: Option<f64>,
    /// Height above ground, m, if one is known and the caller gave no ground resolution; also where `footprint` is unknown for want of
    /// a field of view.
    pub height_agl_m: Option<f64>,
    /// Metadata and priors that were used.
    pub used: Vec<Evidence>,
    /// Metadata and priors that were not used.
    pub set_aside: Vec<Evidence>,
}

impl View {
    pub(crate) fn use_evidence(
        &mut self,
        field: &str,
        value: impl Into<String>,
        reason: impl Into<String>,
    ) {
        self.used.push(Evidence::new(field, value, reason));
    }

    pub(crate) fn set_aside(
        &mut self,
        field: &str,
        value: impl Into<String>,
        reason: impl Into<String>,
    ) {
        self.set_aside.push(Evidence::new(field, value, reason));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_are_read_or_refused() {
        assert_eq!("exif".parse(), Ok(HeadingPrior::FromMetadata));
        assert_eq!("unknown".parse(), Ok(HeadingPrior::Unknown));
        let west = HeadingPrior::Known {
            heading_deg: 270.0,
            sigma_deg: 5.0,
        };
        assert_eq!("-90".parse(), Ok(west));
        for bad in ["north", "NaN", "", "inf", "1e308", "720.5", "-721"] {
            assert!(bad.parse::<HeadingPrior>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_sigma_belongs_to_a_known_heading() {
        let west: HeadingPrior = "-90".parse().unwrap();
        assert_eq!(west.with_sigma_deg(None), Ok(west));
        assert_eq!(
            west.with_sigma_deg(Some(180.0)),
            Ok(HeadingPrior::Known {
                heading_deg: 270.0,
                sigma_deg: 180.0,
            })
        );
        for bad in [0.0, -1.0, 180.5, f64::NAN, f64::INFINITY] {
            let error = west.with_sigma_deg(Some(bad)).unwrap_err();
            assert!(error.contains("up to 180 degrees"), "{error}");
        }
        for other in [HeadingPrior::FromMetadata, HeadingPrior::Unknown] {
            assert_eq!(other.with_sigma_deg(None), Ok(other));
            let error = other.with_sigma_deg(Some(3.0)).unwrap_err();
            assert!(error.contains("without a heading"), "{error}");
        }
    }
}
