//! Masks at the resolutions of the feature maps.

use image::GrayImage;

use crate::NetError;
use crate::spec::{SIZE_MULTIPLE_PX, STAGES};

/// Checks that a mask has the size of its image.
pub(crate) fn check_mask(
    mask: Option<&GrayImage>,
    width_px: u32,
    height_px: u32,
) -> Result<(), NetError> {
    match mask.map(GrayImage::dimensions) {
        Some((mask_width_px, mask_height_px))
            if (mask_width_px, mask_height_px) != (width_px, height_px) =>
        {
            Err(NetError::MaskSize {
                mask_width_px,
                mask_height_px,
                width_px,
                height_px,
            })
        }
        _ => Ok(()),
    }
}

/// Whether at least half of the `pitch_px` square with that corner is visible. Pixels outside the mask are not.
pub(crate) fn square_is_seen(mask: &GrayImage, x_px: u32, y_px: u32, pitch_px: u32) -> bool {
    let (width, height) = (mask.width() as usize, mask.height() as usize);
    let (left, top, pitch) = (x_px as usize, y_px as usize, pitch_px as usize);
    let right = (left + pitch).min(width);
    let rows = (top..(top + pitch).min(height)).filter(|_| left < right);
    let seen: usize = rows
        .map(|y| {
            mask.as_raw()[y * width + left..y * width + right]
                .iter()
                .filter(|&&v| v != 0)
                .count()
        })
        .sum();
    2 * seen >= pitch * pitch
}

/// A mask at the resolutions of the network's layers: a position is visible if at least half of its pixels are.
pub(crate) struct Seen {
    /// At 1/2, 1/4, ... 1/32: one byte per position, row by row.
    levels: Vec<Vec<u8>>,
    full: Vec<u8>,
    height_px: usize,
}

impl Seen {
    /// `mask` has sides that are multiples of 32 px.
    pub(crate) fn new(mask: &GrayImage) -> Self {
        let full: Vec<u8> = mask.as_raw().iter().map(|&v| u8::from(v != 0)).collect();
        let mut width = mask.width() as usize;
        let mut counts: Vec<u32> = full.iter().map(|&v| u32::from(v)).collect();
        let mut levels = Vec::with_capacity(STAGES);
        for level in 1..=STAGES {
            counts = counts
                .chunks_exact(2 * width)
                .flat_map(|rows| {
                    let (top, bottom) = rows.split_at(width);
                    top.chunks_exact(2)
                        .zip(bottom.chunks_exact(2))
                        .map(|(a, b)| a[0] + a[1] + b[0] + b[1])
                })
                .collect();
            width /= 2;
            let half = 1u32 << (2 * level - 1);
            levels.push(
                counts
                    .iter()
                    .map(|&count| u8::from(count >= half))
                    .collect(),
            );
        }
        debug_assert_eq!(1 << STAGES, SIZE_MULTIPLE_PX);
        Self {
            levels,
            full,
            height_px: mask.height() as usize,
        }
    }

    /// The mask for a layer of `height` rows; `None` if no position of it is visible.
    pub(crate) fn at_height(&self, height: usize) -> Option<&[u8]> {
        let ratio = self.height_px.checked_div(height)?;
        let level = match ratio {
            1 => &self.full,
            _ => self.levels.get(ratio.ilog2() as usize - 1)?,
        };
        level.iter().any(|&v| v != 0).then_some(level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn half_a_square_is_enough() {
        let mask = GrayImage::from_fn(64, 32, |x, y| {
            Luma([if x < 20 || y == 9 { 255 } else { 0 }])
        });
        let seen = Seen::new(&mask);
        for (rows, pitch) in [(16, 2), (8, 4), (4, 8), (2, 16), (1, 32)] {
            let level = seen.at_height(rows).unwrap();
            let columns = 64 / pitch;
            for (i, &v) in level.iter().enumerate() {
                let (x, y) = ((i % columns) * pitch, (i / columns) * pitch);
                assert_eq!(
                    v != 0,
                    square_is_seen(&mask, x as u32, y as u32, pitch as u32),
                    "{pitch}: {x}, {y}"
                );
            }
        }
        assert_eq!(
            seen.at_height(16).unwrap()[..12],
            [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0]
        );
        assert_eq!(seen.at_height(1).unwrap(), [1, 0]);
        assert_eq!(seen.at_height(32).unwrap().len(), 64 * 32);
    }

    #[test]
    fn nothing_seen_is_no_mask_and_outside_is_not_seen() {
        let mask = GrayImage::new(32, 32);
        assert!(Seen::new(&mask).at_height(4).is_none());
        let full = GrayImage::from_pixel(32, 32, Luma([1]));
        assert!(
            !square_is_seen(&full, 40, 0, 8)
                && square_is_seen(&full, 28, 0, 8)
                && !square_is_seen(&full, 29, 0, 8)
        );
    }
}
