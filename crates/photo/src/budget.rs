//! The memory that a photo takes while it is decoded, checked before it is allocated.

use std::path::Path;

use grimnet_limits::PhotoLimits;

use crate::error::PhotoError;

/// Minimum side of a photo, px.
pub const MIN_SIDE_PX: u32 = 16;

/// What is in memory besides the decoder's picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MemoryBudget {
    /// The file, and copies of it.
    pub file_bytes: u64,
    /// Whether the picture at full size is copied once more, to turn it upright.
    pub is_copied: bool,
}

impl MemoryBudget {
    /// What decoding a picture of this width and height takes, if it takes `bytes_per_px` for each pixel.
    pub(crate) fn needed_bytes(self, (width_px, height_px): (u32, u32), bytes_per_px: f64) -> u64 {
        let copy = if self.is_copied { 3.0 } else { 0.0 };
        let pixels = f64::from(width_px) * f64::from(height_px);
        // `as` saturates.
        let of_pixels = (pixels * (bytes_per_px + copy)) as u64;
        of_pixels.saturating_add(self.file_bytes)
    }

    /// Returns an error if the photo is too small, or needs more memory than the limit. `bytes_per_px` is what decoding takes for
    /// each pixel.
    pub(crate) fn check(
        self,
        path: &Path,
        (width_px, height_px): (u32, u32),
        bytes_per_px: f64,
        limits: &PhotoLimits,
    ) -> Result<(), PhotoError> {
        let needed_bytes = self.needed_bytes((width_px, height_px), bytes_per_px);
        if needed_bytes > limits.max_memory_bytes {
            return Err(PhotoError::TooLarge {
                path: path.into(),
                width_px,
                height_px,
                needed_bytes,
                limit_bytes: limits.max_memory_bytes,
            });
        }
        if width_px.min(height_px) < MIN_SIDE_PX {
            return Err(PhotoError::TooSmall {
                path: path.into(),
                width_px,
                height_px,
                minimum_px: MIN_SIDE_PX,
            });
        }
        Ok(())
    }
}
