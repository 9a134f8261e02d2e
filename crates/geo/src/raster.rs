//! What a map is to the rest of the house.

use image::{GrayImage, RgbImage};

use crate::{GeoError, Georeference, WindowPx};

/// Pixels of a window, and which of them show the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct RasterPatch {
    /// Colours; black where not valid.
    pub rgb: RgbImage,
    /// 255 where the map has data, 0 outside the map and where it has none. Same size as `rgb`.
    pub valid: GrayImage,
}

/// A georeferenced map whose windows can be read at any ground resolution.
pub trait Raster: Send + Sync {
    /// Width and height at full resolution, pixels.
    fn size_px(&self) -> (u64, u64);

    /// Where it lies.
    fn georeference(&self) -> &Georeference;

    /// BLAKE3 of the bytes of all files that the map consists of. The first call reads them all,
    /// in time linear in their size; later calls answer at once.
    ///
    /// # Errors
    /// If a file cannot be read.
    fn content_hash(&self) -> Result<[u8; 32], GeoError>;

    /// Reads a window, resampled to `out_w` x `out_h` pixels.
    ///
    /// Output pixel `(i, j)` covers the map from `window.x + i * window.w / out_w` to
    /// `window.x + (i + 1) * window.w / out_w`, rows likewise. When reducing, all map pixels under
    /// a triangle twice as wide as an output pixel are averaged (antialiased bilinear, as Pillow's
    /// `BILINEAR` and as photos are resampled), starting from an overview where there is one; when
    /// enlarging, pixels are interpolated bilinearly; at the same scale and on whole pixels they
    /// are copied. Pixels without data have no part in the average; an output pixel is valid if at
    /// least half of its weight fell on data.
    ///
    /// # Errors
    /// If the window is empty or not finite, no pixels or more than 2^28 are asked for, or the
    /// file cannot be decoded.
    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError>;

    /// One line for people: format, size, bands, coordinate system, resolution, overviews.
    fn describe(&self) -> String;
}
