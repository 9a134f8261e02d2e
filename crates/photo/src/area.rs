//! Making pictures smaller by averaging over areas, so that nothing aliases.

use fast_image_resize::images::{Image, ImageRef};
use fast_image_resize::{FilterType, PixelType, ResizeAlg, ResizeOptions, Resizer};
use image::RgbImage;

/// A rectangle of a picture, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Crop {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// The picture itself where its long side is within the limit, else a smaller one of the same aspect.
pub(crate) fn limit_long_side(image: RgbImage, limit_px: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    let long = width.max(height);
    let limit_px = limit_px.max(1);
    if long <= limit_px {
        return image;
    }
    let side = |px: u32| {
        let scaled = f64::from(px) * f64::from(limit_px) / f64::from(long);
        (scaled.round() as u32).max(1)
    };
    let whole = Crop {
        x: 0,
        y: 0,
        width,
        height,
    };
    reduce(&image, whole, side(width), side(height))
}

/// Averages a rectangle of `image` down to `width` x `height` px (triangle filter as wide as two output pixels,
/// the "antialiased bilinear" of Pillow).
pub(crate) fn reduce(image: &RgbImage, crop: Crop, width: u32, height: u32) -> RgbImage {
    let mut reduced = RgbImage::new(width, height);
    let source = ImageRef::new(
        image.width(),
        image.height(),
        image.as_raw(),
        PixelType::U8x3,
    );
    let target = Image::from_slice_u8(width, height, reduced.as_mut(), PixelType::U8x3);
    // Both views were made from buffers of exactly their size, and the crop lies within: neither can fail.
    if let (Ok(source), Ok(mut target)) = (source, target) {
        let options = ResizeOptions::new()
            .resize_alg(ResizeAlg::Convolution(FilterType::Bilinear))
            .crop(
                f64::from(crop.x),
                f64::from(crop.y),
                f64::from(crop.width),
                f64::from(crop.height),
            );
        if let Err(error) = Resizer::new().resize(&source, &mut target, &options) {
            tracing::error!(%error, "resizing failed on a valid picture");
        }
    }
    reduced
}
