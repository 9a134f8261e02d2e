//! Prior knowledge of a photo.

use std::str::FromStr;

use grimnet_geo::{LonLat, distance_m};
use grimnet_photo::{HeadingPrior, ViewPrior};
use serde::{Deserialize, Serialize};

/// An area that contains the photo's centre.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Near {
    /// Centre of the area.
    pub centre: LonLat,
    /// Radius of the area, metres.
    pub radius_m: f64,
}

impl Near {
    /// Whether a place is in the area.
    #[must_use]
    pub fn contains(&self, place: LonLat) -> bool {
        distance_m(self.centre, place) <= self.radius_m
    }
}

/// `LAT,LON,RADIUS_M`, such as `24.26,120.72,500`.
impl FromStr for Near {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
        match numbers.as_deref() {
            Ok(&[lat_deg, lon_deg, radius_m])
                if lat_deg.abs() <= 90.0
                    && lon_deg.abs() <= 180.0
                    && radius_m > 0.0
                    && radius_m.is_finite() =>
            {
                let centre = LonLat { lon_deg, lat_deg };
                Ok(Self { centre, radius_m })
            }
            _ => Err(
                "expected latitude (-90 to 90 degrees), longitude (-180 to 180 degrees) and radius (metres), such as 24.26,120.72,500"
                    .to_owned(),
            ),
        }
    }
}

/// Prior knowledge of a photo. Values that are not given come from the photo's metadata if these are plausible, and are searched
/// otherwise.
///
/// ```
/// use grimnet_locate::Prior;
/// let prior = Prior::none().with_heading(214.0, 5.0).with_height_agl_m(118.0);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Prior {
    /// Heading, pitch, height, field of view and ground resolution.
    #[serde(flatten)]
    pub view: ViewPrior,
    /// An area that contains the photo's centre.
    pub near: Option<Near>,
}

impl Prior {
    /// No knowledge besides the photo and its metadata.
    pub fn none() -> Self {
        Self::default()
    }

    /// The heading (bearing of the photo's top, degrees clockwise from true north) with its 1-sigma, degrees.
    pub fn with_heading(mut self, heading_deg: f64, sigma_deg: f64) -> Self {
        self.view.heading = HeadingPrior::Known {
            heading_deg,
            sigma_deg,
        };
        self
    }

    /// The heading is unknown; metadata are ignored.
    pub fn with_unknown_heading(mut self) -> Self {
        self.view.heading = HeadingPrior::Unknown;
        self
    }

    /// Pitch of the camera, degrees, as gimbals state it: -90 looks straight down, -60 towards the photo's top by 30 degrees. It is of use
    /// where the field of view is known, too.
    pub fn with_pitch_deg(mut self, pitch_deg: f64) -> Self {
        self.view.pitch_deg = Some(pitch_deg);
        self
    }

    /// Height above ground, metres.
    pub fn with_height_agl_m(mut self, height_agl_m: f64) -> Self {
        self.view.height_agl_m = Some(height_agl_m);
        self
    }

    /// Field of view across the photo's width, degrees.
    pub fn with_hfov_deg(mut self, hfov_deg: f64) -> Self {
        self.view.hfov_deg = Some(hfov_deg);
        self
    }

    /// Ground metres per pixel of the photo at full size.
    pub fn with_gsd_m(mut self, gsd_m: f64) -> Self {
        self.view.gsd_m = Some(gsd_m);
        self
    }

    /// The photo's centre is within `radius_m` metres of `centre`.
    pub fn near(mut self, centre: LonLat, radius_m: f64) -> Self {
        self.near = Some(Near { centre, radius_m });
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_are_read_or_refused() {
        let near: Near = "24.26, 120.72, 500".parse().unwrap();
        assert_eq!(near.centre.lat_deg, 24.26);
        assert_eq!(near.radius_m, 500.0);
        // Beyond the antimeridian, as the extent of a map may be.
        let error = "0,180.0001,200".parse::<Near>().unwrap_err();
        assert!(error.contains("-180 to 180"), "{error}");
        for bad in [
            "120.72,24.26,500",
            "24.26,120.72",
            "24.26,oops,120.72,500",
            "24.26,120.72,500,",
            "24.26,120.72,0",
            "24.26,120.72,inf",
            "",
        ] {
            assert!(bad.parse::<Near>().is_err(), "{bad}");
        }
    }
}
