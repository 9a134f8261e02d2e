//! One photo: its pixels and its metadata.

use std::path::{Path, PathBuf};

use image::RgbImage;

use crate::camera::Tilt;
use crate::decode;
use crate::error::PhotoError;
use crate::metadata::Metadata;
use crate::query::{Query, QueryMaker, QueryOptions};
use crate::view::{Overrides, View};

/// No query needs a longer side, pixels.
const QUERY_LONG_SIDE_PX: u32 = 2048;

/// A decoded photo.
#[derive(Debug, Clone)]
pub struct Photo {
    /// Where it came from; empty for pictures made in memory.
    pub path: PathBuf,
    /// Pixels as displayed (EXIF orientation applied), possibly at reduced size.
    pub image: RgbImage,
    /// Size of the whole picture as displayed, px; `image` is this or smaller, of the same field of view.
    pub full_size_px: (u32, u32),
    /// What the file says of itself.
    pub metadata: Metadata,
}

impl Photo {
    /// Reads a JPEG, PNG, TIFF or WebP photo at full size.
    ///
    /// # Errors
    /// A [`PhotoError`] that names the file: unreadable, not a picture, truncated, damaged, too large (checked before
    /// allocation), too small.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, PhotoError> {
        Self::read(path.as_ref(), None)
    }

    /// Reads a photo at a long side of at most `max_long_side_px`; a smaller one keeps its size.
    ///
    /// A query needs far fewer pixels than a camera stores. What is left is averaged over areas, so that nothing
    /// aliases.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn open_reduced(path: impl AsRef<Path>, max_long_side_px: u32) -> Result<Self, PhotoError> {
        Self::read(path.as_ref(), Some(max_long_side_px))
    }

    /// Reads a photo with as many pixels as a query needs.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn open_for_query(path: impl AsRef<Path>) -> Result<Self, PhotoError> {
        Self::open_reduced(path, QUERY_LONG_SIDE_PX)
    }

    /// Decodes a photo file that is in memory already; `path` only names it in errors.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn from_bytes(
        path: impl AsRef<Path>,
        bytes: &[u8],
        max_long_side_px: Option<u32>,
    ) -> Result<Self, PhotoError> {
        let path = path.as_ref();
        let metadata = Metadata::from_bytes(bytes);
        let decoded = decode::decode(path, bytes, metadata.orientation, max_long_side_px)?;
        Ok(Self {
            path: path.to_owned(),
            image: decoded.image,
            full_size_px: decoded.full_size_px,
            metadata,
        })
    }

    /// A photo from pixels in memory.
    pub fn from_image(image: RgbImage, metadata: Metadata) -> Self {
        Self {
            path: PathBuf::new(),
            full_size_px: image.dimensions(),
            image,
            metadata,
        }
    }

    fn read(path: &Path, max_long_side_px: Option<u32>) -> Result<Self, PhotoError> {
        let bytes = fs_err::read(path).map_err(|source| PhotoError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::from_bytes(path, &bytes, max_long_side_px)
    }

    /// What is believed of this photo's view, with the reasons.
    pub fn view(&self, overrides: &Overrides) -> View {
        View::resolve(&self.metadata, self.full_size_px, overrides)
    }

    /// Prepares queries at one ground resolution; cheap to turn afterwards. See [`QueryMaker::new`].
    ///
    /// # Errors
    /// As [`QueryMaker::new`].
    pub fn query_maker(&self, options: &QueryOptions) -> Result<QueryMaker, PhotoError> {
        QueryMaker::new(&self.image, options)
    }

    /// Resamples the photo to `gsd_m` metres per pixel with the map's up direction up.
    ///
    /// `footprint_width_m` is the ground width across the photo's centre. `up_deg` is the bearing of the photo's top
    /// relative to the query's up, clockwise: heading minus the map's up-bearing. With a `tilt`, the ground plane is
    /// rectified. For several rotations make a [`QueryMaker`] once.
    ///
    /// # Errors
    /// As [`QueryMaker::new`], and for an `up_deg` that is not a number.
    pub fn query(
        &self,
        gsd_m: f64,
        footprint_width_m: f64,
        up_deg: f64,
        tilt: Option<Tilt>,
    ) -> Result<Query, PhotoError> {
        let options = QueryOptions {
            tilt,
            ..QueryOptions::new(gsd_m, footprint_width_m)
        };
        if !up_deg.is_finite() {
            return Err(PhotoError::BadRequest {
                name: "up_deg",
                value: up_deg,
                reason: "must be a number of degrees",
            });
        }
        Ok(self.query_maker(&options)?.make(up_deg))
    }
}
