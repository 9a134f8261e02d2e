//! Decoded pictures as blocks.

use grimnet_jpeg::{Damage, Jpeg};
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

/// Decodes a JPEG if `check_size` allows its width and height. Damage is an error: what follows it is shifted, and a map must be
/// where it says.
///
/// # Errors
/// What is wrong, without the name of the file.
pub(crate) fn decode_jpeg(
    bytes: &[u8],
    check_size: impl FnOnce((u32, u32)) -> Result<(), String>,
) -> Result<DynamicImage, String> {
    let jpeg = Jpeg::read(bytes).map_err(|error| error.to_string())?;
    check_size(jpeg.size_px())?;
    let decoded = jpeg.decode().map_err(|error| error.to_string())?;
    match decoded.damage {
        Some(damage) => Err(damage_text(damage)),
        None => Ok(decoded.image.into()),
    }
}

/// Damage of JPEG data in words.
pub(crate) fn damage_text(damage: Damage) -> String {
    format!("its JPEG data have {damage}")
}
