//! Decoded pictures as blocks.

use image::DynamicImage;

use crate::block::{Block, Validity};

/// Smallest alpha of a pixel that has data.
const MIN_ALPHA: u8 = 128;

/// The pixels of a picture; those with an alpha below one half have no data.
pub(crate) fn block_of_picture(picture: DynamicImage) -> Block {
    let width = picture.width() as usize;
    let validity = if picture.color().has_alpha() {
        let alpha = picture.to_rgba8();
        let seen = |alpha: u8| if alpha >= MIN_ALPHA { 255 } else { 0 };
        Validity::from_mask(alpha.pixels().map(|p| seen(p.0[3])).collect())
    } else {
        Validity::All
    };
    if validity == Validity::None {
        return Block::empty(width);
    }
    Block {
        width,
        rgb: picture.into_rgb8().into_raw(),
        validity,
    }
}

/// Whether the last scan of a JPEG is followed by an end marker. The decoder fills what is missing
/// with grey without an error.
pub(crate) fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|w| w == marker);
    match (last([0xFF, 0xDA]), last([0xFF, 0xD9])) {
        (Some(scan), Some(end)) => end > scan,
        _ => false,
    }
}
