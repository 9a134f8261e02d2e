//! How many pixels of a photo the search over a map can use.

use std::path::Path;

use grimnet_pack::{Mode, Pack};
use grimnet_photo::{
    Metadata, Photo, PhotoError, PhotoLimits, QUERY_LONG_SIDE_PX, View, ViewPrior,
};

use crate::{options::Options, pipeline::tile_frame::query_gsd_m};

/// Pixels of the photo for each pixel of the widest query, in each direction.
///
/// More than the resampling reads ([`grimnet_photo::LEVEL_PX_PER_QUERY_PX`]), so that what is averaged twice is not blurred: of 62
/// fixes of 31 drone photos at 1.9 pixels for each of the query's, one was 8 m off in place of 3 m; inliers were no fewer.
const PX_PER_QUERY_PX: f64 = 2.0;
/// Two levels whose resolutions differ by this factor, as those of a pack usually do.
const LEVEL_STEP: f64 = 2.0;

/// How many pixels of a photo the search over a map can use. Made by [`Localizer::needed_pixels`](crate::Localizer::needed_pixels).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeededPixels {
    /// Width of the widest query whose footprint suits a level of the pack, px.
    widest_query_px: f64,
    /// Ground resolution of queries at the coarsest level, m.
    coarsest_gsd_m: f64,
    prior: ViewPrior,
}

impl NeededPixels {
    /// For photos of which `prior` is known.
    pub(crate) fn new(pack: &Pack, options: &Options, prior: &ViewPrior) -> Self {
        let levels = || pack.levels().iter().filter(|level| level.tile_count() > 0);
        let mut gsds_m: Vec<f64> = levels().map(query_gsd_m).collect();
        gsds_m.sort_by(f64::total_cmp);
        let steps = gsds_m.windows(2).map(|pair| pair[1] / pair[0]);
        let largest = |of: &[f64]| of.iter().copied().fold(1.0, f64::max);
        let of_unknown = levels()
            .map(|level| largest(&options.unknown_scales) * f64::from(level.manifest().network_px));
        let widest_query_px = match options.mode {
            // It resizes the whole photo.
            Mode::Paper => f64::INFINITY,
            Mode::Default => of_unknown
                .fold(0.0, f64::max)
                .max(options.query_width_px * steps.fold(LEVEL_STEP, f64::max).sqrt()),
        };
        Self {
            widest_query_px,
            coarsest_gsd_m: gsds_m.last().copied().unwrap_or(f64::INFINITY),
            prior: *prior,
        }
    }

    /// The least long side of a photo with these metadata, and this width and height at full size, px, with which it is found as
    /// well as with all its pixels.
    #[must_use]
    pub fn long_side_px(&self, metadata: &Metadata, full_size_px: (u32, u32)) -> u32 {
        let view = View::resolve(metadata, full_size_px, &self.prior);
        let of_footprint_px = view
            .footprint
            .map_or(0.0, |footprint| footprint.width_m / self.coarsest_gsd_m);
        let width_px = PX_PER_QUERY_PX * of_footprint_px.max(self.widest_query_px);
        let (width, height) = (f64::from(full_size_px.0.max(1)), f64::from(full_size_px.1));
        // `as` saturates.
        let long_side_px = (width_px * (height / width).max(1.0)).ceil() as u32;
        long_side_px.min(QUERY_LONG_SIDE_PX)
    }

    /// Reads a photo with as many pixels as are needed, at most [`QUERY_LONG_SIDE_PX`] along its long side.
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn open(&self, path: impl AsRef<Path>, limits: &PhotoLimits) -> Result<Photo, PhotoError> {
        Photo::open_as_needed(path, limits, |metadata, size_px| {
            self.long_side_px(metadata, size_px)
        })
    }

    /// As [`NeededPixels::open`], from the bytes of a photo file. `path` is only a name, for errors and [`Photo::path`].
    ///
    /// # Errors
    /// As [`Photo::open`].
    pub fn decode(
        &self,
        path: impl AsRef<Path>,
        bytes: &[u8],
        limits: &PhotoLimits,
    ) -> Result<Photo, PhotoError> {
        Photo::from_bytes_as_needed(path, bytes, limits, |metadata, size_px| {
            self.long_side_px(metadata, size_px)
        })
    }
}
