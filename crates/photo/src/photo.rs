//! One photo: its pixels and its metadata.

use std::path::{Path, PathBuf};

use grimnet_jpeg::Damage;
use grimnet_limits::PhotoLimits;
use image::RgbImage;

use crate::area;
use crate::camera::Tilt;
use crate::decode::{Decoded, DecodedSize, decode};
use crate::error::PhotoError;
use crate::metadata::Metadata;
use crate::photo_file::read_photo_file;
use crate::query::{DEFAULT_MAX_SIDE_PX, Query, QueryMaker, QueryOptions};
use crate::view::{View, ViewPrior};
use crate::warp::LEVEL_PX_PER_QUERY_PX;

/// [`Photo::open`] reduces longer sides to this, pixels: no query needs more.
pub const QUERY_LONG_SIDE_PX: u32 = 2048;

/// Long side, pixels, that serves every query of the default size.
const SUFFICIENT_LONG_SIDE_PX: u32 = (LEVEL_PX_PER_QUERY_PX * DEFAULT_MAX_SIDE_PX as f64) as u32;

/// A decoded photo.
#[derive(Debug, Clone)]
pub struct Photo {
    /// The file, or the name that was given with its bytes; empty for photos made of pixels.
    pub path: PathBuf,
    /// Pixels as displayed (EXIF orientation applied), possibly at reduced size.
    pub image: RgbImage,
    /// Size of the whole picture as displayed, px. `image` has this size or is smaller, with the same field of view.
    pub full_size_px: (u32, u32),
    /// EXIF and XMP metadata.
    pub metadata: Metadata,
    /// Damage that was found while decoding: part of the picture is wrong or shifted. A position is not computed from it.
    pub damage: Option<Damage>,
}

impl Photo {
    /// Reads a JPEG, PNG, TIFF or WebP photo at the size that localisation needs: a long side of at most
    /// [`QUERY_LONG_SIDE_PX`], as [`Photo::open_as_needed`] does with what serves every query.
    ///
    /// # Errors
    /// Returns a [`PhotoError`] that names the file if it is unreadable, not a picture, truncated, too large (checked before
    /// allocation) or too small, or its headers are damaged. Damage of the compressed data is in [`Photo::damage`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, PhotoError> {
        Self::open_as_needed(path, &PhotoLimits::DEFAULT, |_, _| SUFFICIENT_LONG_SIDE_PX)
    }

    /// Reads a photo at full size.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn open_full(path: impl AsRef<Path>) -> Result<Self, PhotoError> {
        Self::open_with(path, None, &PhotoLimits::DEFAULT)
    }

    /// Reads a photo with a long side of at most `max_long_side_px`; a smaller photo keeps its size. Pixels are averaged over
    /// areas, so that the reduction does not alias.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn open_reduced(path: impl AsRef<Path>, max_long_side_px: u32) -> Result<Self, PhotoError> {
        Self::open_with(path, Some(max_long_side_px), &PhotoLimits::DEFAULT)
    }

    /// Reads a photo within other limits than the default ones, at full size if `max_long_side_px` is `None`.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn open_with(
        path: impl AsRef<Path>,
        max_long_side_px: Option<u32>,
        limits: &PhotoLimits,
    ) -> Result<Self, PhotoError> {
        let path = path.as_ref();
        let bytes = read_photo_file(path, limits)?;
        Self::from_bytes_within(path, &bytes, max_long_side_px, limits)
    }

    /// Decodes the bytes of a photo file, at full size if `max_long_side_px` is `None`. `path` is only a name,
    /// for errors and [`Photo::path`].
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn from_bytes(
        path: impl AsRef<Path>,
        bytes: &[u8],
        max_long_side_px: Option<u32>,
    ) -> Result<Self, PhotoError> {
        Self::from_bytes_within(path, bytes, max_long_side_px, &PhotoLimits::DEFAULT)
    }

    /// As [`Photo::from_bytes`], within other limits: for photos of strangers.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn from_bytes_within(
        path: impl AsRef<Path>,
        bytes: &[u8],
        max_long_side_px: Option<u32>,
        limits: &PhotoLimits,
    ) -> Result<Self, PhotoError> {
        let metadata = Metadata::from_bytes(bytes);
        let size = DecodedSize {
            max_long_side_px,
            needed_long_side_px: &|_| u32::MAX,
        };
        let path = path.as_ref();
        let decoded = decode(path, bytes, metadata.orientation, size, limits)?;
        Ok(Self::of_file(path, decoded, metadata))
    }

    /// Reads a photo at a size that its metadata decide: `needed_long_side_px` gets them with the photo's full width and height as
    /// displayed, px, and says what long side serves. JPEG files with a longer side than [`QUERY_LONG_SIDE_PX`] are decoded at the
    /// smallest of 1/8, 1/4, 1/2 of their size and their own that suffices, which takes less time; the area of the last column and
    /// row may lie partly beyond the photo. What is still longer is reduced to that.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn open_as_needed(
        path: impl AsRef<Path>,
        limits: &PhotoLimits,
        needed_long_side_px: impl Fn(&Metadata, (u32, u32)) -> u32,
    ) -> Result<Self, PhotoError> {
        let path = path.as_ref();
        let bytes = read_photo_file(path, limits)?;
        Self::from_bytes_as_needed(path, &bytes, limits, needed_long_side_px)
    }

    /// As [`Photo::open_as_needed`], from the bytes of a photo file. `path` is only a name, for errors and [`Photo::path`].
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn from_bytes_as_needed(
        path: impl AsRef<Path>,
        bytes: &[u8],
        limits: &PhotoLimits,
        needed_long_side_px: impl Fn(&Metadata, (u32, u32)) -> u32,
    ) -> Result<Self, PhotoError> {
        let metadata = Metadata::from_bytes(bytes);
        let size = DecodedSize {
            max_long_side_px: Some(QUERY_LONG_SIDE_PX),
            needed_long_side_px: &|full_size_px: (u32, u32)| {
                if full_size_px.0.max(full_size_px.1) > QUERY_LONG_SIDE_PX {
                    needed_long_side_px(&metadata, full_size_px)
                } else {
                    // Decoded fast as it is.
                    u32::MAX
                }
            },
        };
        let path = path.as_ref();
        let decoded = decode(path, bytes, metadata.orientation, size, limits)?;
        Ok(Self::of_file(path, decoded, metadata))
    }

    fn of_file(path: &Path, decoded: Decoded, metadata: Metadata) -> Self {
        Self {
            path: path.to_owned(),
            image: decoded.image,
            full_size_px: decoded.full_size_px,
            metadata,
            damage: decoded.damage,
        }
    }

    /// A photo from pixels in memory.
    pub fn from_image(image: RgbImage, metadata: Metadata) -> Self {
        Self {
            path: PathBuf::new(),
            full_size_px: image.dimensions(),
            image,
            metadata,
            damage: None,
        }
    }

    /// A photo from pixels in memory, with a long side of at most `max_long_side_px` as in [`Photo::open_reduced`].
    pub fn from_image_reduced(image: RgbImage, metadata: Metadata, max_long_side_px: u32) -> Self {
        let full_size_px = image.dimensions();
        Self {
            image: area::limit_long_side(image, max_long_side_px),
            full_size_px,
            path: PathBuf::new(),
            metadata,
            damage: None,
        }
    }

    /// What is known of this photo's view, with the reasons. See [`View::resolve`].
    pub fn view(&self, prior: &ViewPrior) -> View {
        View::resolve(&self.metadata, self.full_size_px, prior)
    }

    /// Prepares queries at one ground resolution, which are then cheap to rotate. See [`QueryMaker::new`].
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
    /// As [`QueryMaker::new`]; also if `up_deg` is not finite.
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
                reason: "expected a finite number of degrees",
            });
        }
        Ok(self.query_maker(&options)?.make(up_deg))
    }
}
