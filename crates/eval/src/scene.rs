//! A map with photos whose true position is known: what is evaluated, calibrated on and experimented with.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use grimnet_geo::{LonLat, Raster};
use grimnet_locate::{HeadingPrior, Prior};
use grimnet_photo::{Metadata, Photo, PhotoError, PhotoLimits, QUERY_LONG_SIDE_PX};

/// Standard deviation with which a true heading is given to the localiser, degrees.
pub const TRUE_HEADING_SIGMA_DEG: f64 = 5.0;

/// Largest share of a photo without features at which it counts as answerable.
pub const MAX_FEATURELESS_SHARE: f64 = 0.5;

/// A map and photos of it.
pub struct Scene {
    /// Name, for people and for columns of tables.
    pub name: String,
    /// The map.
    pub map: Box<dyn Raster>,
    /// The photos, in the order of flight.
    pub shots: Vec<Shot>,
}

/// One photo, its truth, and what the localiser may be given of it.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Name of the photo.
    pub name: String,
    /// The photo.
    pub photo: PhotoSource,
    /// Its truth.
    pub truth: Truth,
    /// Everything that is known of the view beside the photo's metadata, with the heading.
    pub known: Prior,
    /// Ground width of the photo that the localiser is given instead of its metadata, metres.
    pub footprint_width_m: Option<f64>,
}

/// The truth of one photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Position that answers are compared with: the image centre, or the receiver if the centre is not known.
    pub position: LonLat,
    /// Position of the satellite receiver, if it is known.
    pub receiver: Option<LonLat>,
    /// Standard deviation of `position`, metres per axis, if it is known.
    pub error_m: Option<f64>,
    /// Name of the place that the photo shows; photos of one place are not independent.
    pub place: Option<String>,
    /// Share of the photo without features, if it is known.
    pub featureless_share: Option<f64>,
    /// Angle between the camera's axis and straight down, degrees, if it is known.
    pub tilt_deg: Option<f64>,
}

impl Truth {
    /// A position of which nothing else is known.
    #[must_use]
    pub fn at(position: LonLat) -> Self {
        Self {
            position,
            receiver: None,
            error_m: None,
            place: None,
            featureless_share: None,
            tilt_deg: None,
        }
    }

    /// Returns whether the photo has enough features to be localised; true if that is not known.
    #[must_use]
    pub fn is_answerable(&self) -> bool {
        self.featureless_share
            .is_none_or(|share| share <= MAX_FEATURELESS_SHARE)
    }
}

/// Where a photo comes from.
#[derive(Debug, Clone)]
pub enum PhotoSource {
    /// A file, decoded each time it is needed.
    File {
        /// Its path.
        path: PathBuf,
        /// Limits within which it is read.
        limits: PhotoLimits,
    },
    /// A decoded photo.
    Memory(Arc<Photo>),
}

impl PhotoSource {
    /// Opens the photo, with as many pixels as any query needs.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open(&self) -> Result<Arc<Photo>, PhotoError> {
        self.open_as_needed(|_, _| QUERY_LONG_SIDE_PX)
    }

    /// Opens the photo as [`Photo::open_as_needed`] does; one in memory as it is.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open_as_needed(
        &self,
        needed_long_side_px: impl Fn(&Metadata, (u32, u32)) -> u32,
    ) -> Result<Arc<Photo>, PhotoError> {
        match self {
            Self::File { path, limits } => {
                let photo = Photo::open_as_needed(path, limits, needed_long_side_px)?;
                Ok(Arc::new(photo))
            }
            Self::Memory(photo) => Ok(photo.clone()),
        }
    }

    /// Path of the file; `None` for a photo in memory.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::File { path, .. } => Some(path),
            Self::Memory(_) => None,
        }
    }
}

/// What the localiser is given of the heading.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum HeadingMode {
    /// The true heading, where it is known; otherwise as [`HeadingMode::FromPhoto`].
    #[default]
    Known,
    /// Nothing: the heading is searched.
    Unknown,
    /// What the photo's metadata say.
    FromPhoto,
}

impl HeadingMode {
    /// Name of runs in this mode.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Known => "heading known",
            Self::Unknown => "heading unknown",
            Self::FromPhoto => "heading from the photo",
        }
    }
}

impl Shot {
    /// What the localiser is given of this shot's photo, which has this width and height at full size as displayed, px.
    #[must_use]
    pub fn prior(&self, heading: HeadingMode, full_size_px: (u32, u32)) -> Prior {
        let mut prior = self.known;
        match heading {
            HeadingMode::Known => {}
            HeadingMode::Unknown => prior.view.heading = HeadingPrior::Unknown,
            HeadingMode::FromPhoto => prior.view.heading = HeadingPrior::FromMetadata,
        }
        match self.footprint_width_m {
            Some(width_m) => prior.with_gsd_m(width_m / f64::from(full_size_px.0)),
            None => prior,
        }
    }

    /// Ground width of the photo by what is known and by its metadata, metres.
    ///
    /// # Errors
    /// The photo cannot be read.
    pub fn ground_width_m(&self) -> Result<Option<f64>, PhotoError> {
        let photo = self.photo.open()?;
        let view = photo.view(&self.prior(HeadingMode::Known, photo.full_size_px).view);
        Ok(view.footprint.map(|footprint| footprint.width_m))
    }
}

impl Scene {
    /// Decodes all photos and keeps them in memory, for scenes that are localised many times.
    ///
    /// # Errors
    /// A photo cannot be read.
    pub fn decoded(self) -> Result<Self, PhotoError> {
        let shots = self
            .shots
            .into_iter()
            .map(|shot| {
                Ok(Shot {
                    photo: PhotoSource::Memory(shot.photo.open()?),
                    ..shot
                })
            })
            .collect::<Result<_, PhotoError>>()?;
        Ok(Self { shots, ..self })
    }

    /// Ground width of the photos, metres: the median of those that are known.
    ///
    /// # Errors
    /// A photo cannot be read.
    pub fn ground_width_m(&self) -> Result<Option<f64>, PhotoError> {
        let mut widths = Vec::new();
        for shot in &self.shots {
            widths.extend(shot.ground_width_m()?);
        }
        widths.sort_by(f64::total_cmp);
        Ok(widths.get(widths.len() / 2).copied())
    }
}
