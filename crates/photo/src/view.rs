//! From metadata and the user's word to what is believed of a photo's view, with the reasons.

use serde::Serialize;

use crate::camera::Tilt;
use crate::evidence::Evidence;
use crate::metadata::Metadata;
use crate::{heading, scale};

/// What the user says of the heading.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub enum HeadingSource {
    /// The top of the photo points this many degrees clockwise from true north.
    Known(f64),
    /// Take it from the metadata, if they have it.
    #[default]
    Exif,
    /// It is not known, whatever the metadata say.
    Unknown,
}

/// What the user says of the view, before which metadata give way.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Overrides {
    /// Heading.
    pub heading: HeadingSource,
    /// Height above ground, m.
    pub height_agl_m: Option<f64>,
    /// Field of view across the photo's width, degrees.
    pub hfov_deg: Option<f64>,
    /// Ground metres per pixel of the photo file, at its centre.
    pub gsd_m: Option<f64>,
}

/// A heading that is believed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Heading {
    /// Where the top of the (displayed) photo points, degrees clockwise from true north, 0 to 360.
    pub heading_deg: f64,
    /// 1-sigma, degrees.
    pub sigma_deg: f64,
}

/// A ground width that is believed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Footprint {
    /// Ground width across the photo's centre, m.
    pub width_m: f64,
    /// Relative 1-sigma: 0.15 says 15 %.
    pub relative_sigma: f64,
}

impl Footprint {
    /// Whether the scale is certain enough to be tried alone: a ratio of 1.5 still matches, twice the sigma must not
    /// reach it.
    pub fn is_doubtful(&self) -> bool {
        self.relative_sigma > 0.1
    }

    /// Ground metres per pixel of a photo `width_px` wide.
    pub fn gsd_m(&self, width_px: u32) -> f64 {
        self.width_m / f64::from(width_px.max(1))
    }

    /// Ground corners of the photo (top left, top right, bottom right, bottom left), metres east and north of its
    /// centre, for a camera that looks straight down.
    pub fn corners_en_m(&self, size_px: (u32, u32), heading_deg: f64) -> [[f64; 2]; 4] {
        let half_right = self.width_m / 2.0;
        let half_up = half_right * f64::from(size_px.1) / f64::from(size_px.0.max(1));
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(x, y)| {
            let (right, up) = (x * half_right, y * half_up);
            [right * cos + up * sin, -right * sin + up * cos]
        })
    }
}

/// What is believed of how a photo sees the ground. Everything may be unknown; a localiser then searches.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct View {
    /// Where the photo's top points.
    pub heading: Option<Heading>,
    /// How much ground it covers.
    pub footprint: Option<Footprint>,
    /// How far it looks off straight down, where that is recorded and at least a degree; `None` is taken as straight
    /// down.
    pub tilt: Option<Tilt>,
    /// Field of view across the displayed photo's width, degrees.
    pub hfov_deg: Option<f64>,
    /// Height above ground, m, where `footprint` comes from one.
    pub height_agl_m: Option<f64>,
    /// What the above rest on.
    pub used: Vec<Evidence>,
    /// What was read and not believed.
    pub set_aside: Vec<Evidence>,
}

impl View {
    /// Decides what to believe. `size_px` is the displayed size of the photo file ([`crate::Photo::full_size_px`]).
    ///
    /// The user's word comes first. Of the metadata, the gimbal's yaw comes before the aircraft's and before EXIF's
    /// image direction; height above the sea is never taken for height above ground; height above the take-off point
    /// is taken with a relative 1-sigma of 15 %.
    pub fn resolve(metadata: &Metadata, size_px: (u32, u32), overrides: &Overrides) -> Self {
        let mut view = Self::default();
        view.set_aside.extend(metadata.notes.iter().cloned());
        let attitude = heading::resolve(metadata, overrides, &mut view);
        scale::resolve(metadata, size_px, overrides, attitude, &mut view);
        view
    }

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
