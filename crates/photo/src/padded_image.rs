//! A reduced photo with a border, in the memory layout of the resampler.

use image::RgbImage;

use crate::area::Crop;

/// Pixels of four bytes with a border that repeats the edge, so that filter taps need no bounds check.
#[derive(Debug)]
pub(crate) struct PaddedImage {
    pub width: usize,
    pub height: usize,
    stride: usize,
    pixels: Vec<[u8; 4]>,
}

impl PaddedImage {
    /// Width of the border: the largest reach of a filter tap beyond the picture, px.
    pub const BORDER: usize = 3;

    /// The part of `image` within `crop`.
    pub(crate) fn new(image: &RgbImage, crop: Crop) -> Self {
        let (width, height) = (crop.width as usize, crop.height as usize);
        let stride = width + 2 * Self::BORDER;
        let mut pixels = vec![[0; 4]; stride * (height + 2 * Self::BORDER)];
        let row_bytes = 3 * image.width() as usize;
        for (y, row) in pixels.chunks_exact_mut(stride).enumerate() {
            let source_y = y.saturating_sub(Self::BORDER).min(height.saturating_sub(1));
            let start = (crop.y as usize + source_y) * row_bytes + 3 * crop.x as usize;
            let (body, _) = image.as_raw()[start..start + 3 * width].as_chunks::<3>();
            for (out, &[r, g, b]) in row[Self::BORDER..].iter_mut().zip(body) {
                *out = [r, g, b, 0];
            }
            let (first, last) = (row[Self::BORDER], row[Self::BORDER + width - 1]);
            row[..Self::BORDER].fill(first);
            row[Self::BORDER + width..].fill(last);
        }
        Self {
            width,
            height,
            stride,
            pixels,
        }
    }

    /// `N` neighbouring pixels of one row, `x` and `y` counted from the border's outer corner.
    #[inline(always)]
    pub(crate) fn taps<const N: usize>(&self, x: usize, y: usize) -> &[[u8; 4]; N] {
        let start = y * self.stride + x;
        match self.pixels.get(start..).and_then(|row| row.first_chunk()) {
            Some(taps) => taps,
            // Unreachable, because callers stay within the border.
            None => const { &[[0; 4]; N] },
        }
    }
}
