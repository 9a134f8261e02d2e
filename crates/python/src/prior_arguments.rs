//! Keyword arguments that say what is known of a photo besides its pixels.

use grimnet_locate::{HeadingPrior, Near, Prior, ViewPrior};
use pyo3::prelude::*;
use pyo3::types::PyString;

use crate::errors::{invalid_value, locate_error};

/// The arguments as they are given.
pub struct PriorArguments<'a, 'py> {
    /// Degrees clockwise from true north, `exif` or `unknown`; `None` is `exif`.
    pub heading: Option<&'a Bound<'py, PyAny>>,
    /// 1-sigma of the heading, degrees.
    pub heading_sigma_deg: Option<f64>,
    /// Pitch of the camera, degrees; -90 is straight down.
    pub pitch_deg: Option<f64>,
    /// Height above ground, metres.
    pub height_agl_m: Option<f64>,
    /// Field of view across the photo's width, degrees.
    pub hfov_deg: Option<f64>,
    /// Ground metres per pixel of the full-size photo.
    pub gsd_m: Option<f64>,
    /// Latitude, longitude (degrees) and radius (metres) of the area to search.
    pub near: Option<[f64; 3]>,
}

impl PriorArguments<'_, '_> {
    /// The prior of the localiser.
    ///
    /// # Errors
    /// `InvalidValueError` for what is not understood, out of range or contradicts itself.
    pub fn prior(&self) -> PyResult<Prior> {
        if self.gsd_m.is_some() && (self.height_agl_m.is_some() || self.hfov_deg.is_some()) {
            return Err(invalid_value(
                "gsd_m is given together with height_agl_m or hfov_deg; expected either the ground resolution or what it follows from",
            ));
        }
        let prior = Prior {
            view: ViewPrior {
                heading: self.heading()?,
                pitch_deg: self.pitch_deg,
                roll_deg: None,
                height_agl_m: self.height_agl_m,
                hfov_deg: self.hfov_deg,
                gsd_m: self.gsd_m,
            },
            near: self.near()?,
        };
        // Here, so that a frame with a wrong value never reaches its track.
        prior.check().map_err(|error| locate_error(&error))?;
        Ok(prior)
    }

    fn heading(&self) -> PyResult<HeadingPrior> {
        let text = match self.heading {
            None => "exif".to_owned(),
            Some(text) if text.is_instance_of::<PyString>() => text.extract()?,
            Some(number) => number.extract::<f64>()?.to_string(),
        };
        let heading: HeadingPrior = text
            .parse()
            .map_err(|expected| invalid_value(format!("heading is {text:?}; {expected}")))?;
        heading
            .with_sigma_deg(self.heading_sigma_deg)
            .map_err(invalid_value)
    }

    fn near(&self) -> PyResult<Option<Near>> {
        let Some([lat_deg, lon_deg, radius_m]) = self.near else {
            return Ok(None);
        };
        let text = format!("{lat_deg},{lon_deg},{radius_m}");
        text.parse()
            .map(Some)
            .map_err(|expected: String| invalid_value(format!("near is {text}; {expected}")))
    }
}
