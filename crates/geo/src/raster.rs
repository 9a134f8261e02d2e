//! The interface of a map.

use std::path::PathBuf;

use image::{GrayImage, RgbImage};

use crate::{GeoError, Georeference, WindowPx};

/// Pixels of a window, and which of them have data.
#[derive(Debug, Clone, PartialEq)]
pub struct RasterPatch {
    /// Colours; black where there is no data.
    pub rgb: RgbImage,
    /// 255 where the map has data, 0 outside the map and where it has none. Same size as `rgb`.
    pub valid: GrayImage,
}

/// A georeferenced map whose windows can be read at any ground resolution.
pub trait Raster: Send + Sync {
    /// Width and height at full resolution, pixels.
    fn size_px(&self) -> (u64, u64);

    /// The georeference.
    fn georeference(&self) -> &Georeference;

    /// BLAKE3 of the bytes of all files that the map's pixels are made of, with what the map takes from files that describe them
    /// (world files, `.aux.xml`, a VRT). The first call reads all files; later calls return the stored hash.
    ///
    /// # Errors
    /// Returns an error if a file cannot be read.
    fn content_hash(&self) -> Result<[u8; 32], GeoError>;

    /// As [`Raster::content_hash`], but all files are read again: it differs if one of them was changed since.
    ///
    /// # Errors
    /// Returns an error if a file cannot be read.
    fn content_hash_now(&self) -> Result<[u8; 32], GeoError> {
        self.content_hash()
    }

    /// Reads a window, resampled to `out_w` x `out_h` pixels.
    ///
    /// Output pixel `(i, j)` covers the map from `window.x + i * window.w / out_w` to
    /// `window.x + (i + 1) * window.w / out_w`, rows likewise. When reducing, all map pixels under
    /// a triangle twice as wide as an output pixel are averaged (antialiased bilinear, as Pillow's
    /// `BILINEAR` and as photos are resampled), starting from an overview if there is one; when
    /// enlarging, pixels are interpolated bilinearly; at the same scale and on whole pixels they
    /// are copied. Pixels without data are left out of the average; an output pixel is valid if at least half of its
    /// weight is on data.
    ///
    /// # Errors
    /// Returns an error if the window is empty, not finite or more than 2^27 pixels long, if the output has no pixels or
    /// more than 2^28, or if the file cannot be decoded.
    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError>;

    /// The files that the map is read from, with those that describe it (world files, `.aux.xml`): an output must not
    /// replace them. A folder stands for all files below it.
    fn files(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// A description in one line: format, size, bands, coordinate system, resolution, overviews.
    fn describe(&self) -> String;

    /// What may be wrong with the map, a sentence each: the map can be used, but may not be what was meant.
    fn caveats(&self) -> Vec<String> {
        Vec::new()
    }
}
