//! What the caller knows of a photo beside the photo.

use grimnet_geo::LonLat;
use grimnet_photo::{HeadingSource, Overrides};
use serde::{Deserialize, Serialize};

use crate::error::{LocateError, Result};

/// What is said of the heading: the bearing of the photo's top, degrees clockwise from true north.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadingPrior {
    /// It is known.
    Known {
        /// Degrees clockwise from true north.
        heading_deg: f64,
        /// 1-sigma, degrees.
        sigma_deg: f64,
    },
    /// As the photo's metadata have it, if they are believed; else it is searched.
    #[default]
    FromPhoto,
    /// It is searched, whatever the metadata say.
    Unknown,
}

/// An area that the photo's centre lies in.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Near {
    /// Middle of the area.
    pub centre: LonLat,
    /// Its radius, metres.
    pub radius_m: f64,
}

/// What the caller knows; whatever is left out comes from the photo's metadata where these are believed, or is searched.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Prior {
    /// Heading.
    pub heading: HeadingPrior,
    /// Height above ground, metres.
    pub height_agl_m: Option<f64>,
    /// Field of view across the photo's width, degrees.
    pub hfov_deg: Option<f64>,
    /// Ground metres per pixel of the photo at full size.
    pub gsd_m: Option<f64>,
    /// Where to look.
    pub near: Option<Near>,
}

impl Prior {
    /// Nothing is known beside the photo.
    pub fn none() -> Self {
        Self::default()
    }

    /// The heading is known to `sigma_deg`.
    pub fn with_heading(self, heading_deg: f64, sigma_deg: f64) -> Self {
        Self {
            heading: HeadingPrior::Known {
                heading_deg,
                sigma_deg,
            },
            ..self
        }
    }

    /// The heading is to be searched, whatever the metadata say.
    pub fn with_unknown_heading(self) -> Self {
        Self {
            heading: HeadingPrior::Unknown,
            ..self
        }
    }

    /// Metres per pixel of the photo at full size.
    pub fn with_gsd_m(self, gsd_m: f64) -> Self {
        Self {
            gsd_m: Some(gsd_m),
            ..self
        }
    }

    /// The photo's centre lies within `radius_m` of `centre`.
    pub fn near(self, centre: LonLat, radius_m: f64) -> Self {
        Self {
            near: Some(Near { centre, radius_m }),
            ..self
        }
    }

    /// Checks that it means something.
    ///
    /// # Errors
    /// [`LocateError::BadOption`] where the area is none.
    pub fn check(&self) -> Result<()> {
        match &self.near {
            Some(near) if !(near.centre.is_valid() && near.radius_m > 0.0) => {
                Err(LocateError::BadOption {
                    name: "near",
                    value: format!("{near:?}"),
                    expected: "a place in degrees and a radius in metres above zero",
                })
            }
            _ => Ok(()),
        }
    }

    /// The same, as the photo takes it.
    pub fn overrides(&self) -> Overrides {
        let heading = match self.heading {
            HeadingPrior::Known { heading_deg, .. } => HeadingSource::Known(heading_deg),
            HeadingPrior::FromPhoto => HeadingSource::Exif,
            HeadingPrior::Unknown => HeadingSource::Unknown,
        };
        Overrides {
            heading,
            height_agl_m: self.height_agl_m,
            hfov_deg: self.hfov_deg,
            gsd_m: self.gsd_m,
        }
    }
}
