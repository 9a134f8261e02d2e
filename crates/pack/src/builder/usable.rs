//! Which pixels of a map have image content: valid, and not part of a black margin.

use grimnet_geo::RasterPatch;
use image::{GrayImage, Luma};

/// Pixels with no channel above this are near-black. Margins of maps that declare no nodata value are 0, and a
/// little more after JPEG.
const NEAR_BLACK: u8 = 8;

/// Near-black counts as empty in squares of this side; smaller dark spots are shadows.
const BLACK_SQUARE_PX: u32 = 8;

/// Cells with a smaller share of usable pixels inside the map are skipped.
pub const MIN_USABLE_OF_CELL: f64 = 0.05;

/// Tiles with a smaller share of usable pixels inside the map are skipped: a neighbour, shifted by half, covers that
/// part better.
pub const MIN_USABLE_OF_TILE: f64 = 0.25;

/// 255 where the map has image content, 0 elsewhere.
pub fn usable_mask(patch: &RasterPatch) -> GrayImage {
    let (width, height) = patch.rgb.dimensions();
    let mut mask = patch.valid.clone();
    for top in (0..height).step_by(BLACK_SQUARE_PX as usize) {
        for left in (0..width).step_by(BLACK_SQUARE_PX as usize) {
            let rows = top..(top + BLACK_SQUARE_PX).min(height);
            let columns = left..(left + BLACK_SQUARE_PX).min(width);
            let near_black = rows.clone().all(|y| {
                columns
                    .clone()
                    .all(|x| patch.rgb.get_pixel(x, y).0.iter().all(|&v| v <= NEAR_BLACK))
            });
            if near_black {
                for y in rows {
                    columns
                        .clone()
                        .for_each(|x| mask.put_pixel(x, y, Luma([0])));
                }
            }
        }
    }
    mask
}

/// Number of usable pixels in a square of a mask.
pub fn usable_px(mask: &GrayImage, left: u32, top: u32, side: u32) -> u64 {
    let width = mask.width() as usize;
    let rows = (top..top + side).map(|y| y as usize * width + left as usize);
    rows.map(|start| {
        mask.as_raw()[start..start + side as usize]
            .iter()
            .filter(|&&v| v != 0)
            .count() as u64
    })
    .sum()
}

/// The mask, or `None` if it hides nothing.
pub fn mask_if_partial(mask: &GrayImage) -> Option<&GrayImage> {
    mask.as_raw().contains(&0).then_some(mask)
}

/// Whether at least a share `min` of the pixels inside the map is usable.
pub fn is_enough(usable_px: u64, inside_px: u64, min: f64) -> bool {
    usable_px > 0 && usable_px as f64 >= min * inside_px as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    #[test]
    fn margins_are_empty_and_shadows_are_not() {
        let rgb = RgbImage::from_fn(32, 16, |x, y| {
            let margin = x < 12;
            let shadow = (20..25).contains(&x) && (3..9).contains(&y);
            Rgb([if margin || shadow { 5 } else { 90 }; 3])
        });
        let valid = GrayImage::from_fn(32, 16, |_, y| Luma([if y < 14 { 255 } else { 0 }]));
        let mask = usable_mask(&RasterPatch { rgb, valid });
        assert_eq!(mask.get_pixel(3, 3).0, [0]);
        assert_eq!(
            mask.get_pixel(10, 3).0,
            [255],
            "the square from 8 to 15 is not black altogether"
        );
        assert_eq!(mask.get_pixel(22, 5).0, [255]);
        assert_eq!(mask.get_pixel(30, 15).0, [0]);
        assert_eq!(usable_px(&mask, 0, 0, 16), 8 * 14);
    }

    #[test]
    fn enough_is_relative_to_the_map() {
        assert!(is_enough(10, 20, 0.25) && !is_enough(4, 20, 0.25) && !is_enough(0, 0, 0.0));
    }
}
