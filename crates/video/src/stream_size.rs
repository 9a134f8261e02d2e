//! What a stream's parameter sets say of its pictures, read before anything is decoded.

use crate::colour::ColourDescription;
use crate::pixel_aspect::PixelAspect;

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct StreamSize {
    /// As coded, px.
    pub width: u64,
    pub height: u64,
    /// Columns at the left and rows at the top that are not shown, px, if the decoder leaves them in its pictures.
    pub hidden_px: (usize, usize),
    /// Pictures that the decoder keeps.
    pub pictures: u64,
    /// Memory of each, bytes for each pixel: samples, motion, and the decoder's tables.
    pub bytes_per_px: u64,
    pub colour: Option<ColourDescription>,
    pub aspect: Option<PixelAspect>,
}

impl StreamSize {
    /// Memory of the decoder and of a picture that is converted and becomes `stretch` times as large with square pixels.
    pub(crate) fn memory_bytes(&self, stretch: f64) -> u64 {
        // A converted picture, and its rotated copy.
        let converted = (6.0 * stretch).ceil() as u64;
        let bytes_per_px = (self.pictures * self.bytes_per_px).saturating_add(converted);
        self.width
            .saturating_mul(self.height)
            .saturating_mul(bytes_per_px)
    }
}
