//! From a photo file to 8-bit RGB, sizes checked before anything is allocated.

use std::io::Cursor;
use std::path::Path;

use grimnet_jpeg::{Damage, DecodedJpeg, Jpeg, JpegError};
use grimnet_limits::PhotoLimits;
use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, RgbImage};

use crate::area;
use crate::budget::MemoryBudget;
use crate::error::PhotoError;

/// What the metadata of a PNG file may take, decompressed, bytes: colour profiles have less than 4 MiB, XMP less than 1 MiB.
const MAX_PNG_METADATA_BYTES: u64 = 32 << 20;

/// Pixels of one file, with EXIF orientation applied.
#[derive(Debug)]
pub(crate) struct Decoded {
    pub image: RgbImage,
    /// Size of the whole picture after orientation, px.
    pub full_size_px: (u32, u32),
    pub damage: Option<Damage>,
}

/// Decodes a file's bytes, reduced if `max_long_side_px` is less than its long side.
pub(crate) fn decode(
    path: &Path,
    bytes: &[u8],
    orientation: u8,
    max_long_side_px: Option<u32>,
    limits: &PhotoLimits,
) -> Result<Decoded, PhotoError> {
    if bytes.is_empty() {
        return Err(PhotoError::Empty { path: path.into() });
    }
    let format = image::guess_format(bytes).map_err(|_| PhotoError::Unsupported {
        path: path.into(),
        found: "not a picture (unknown file signature)".into(),
    })?;
    let orientation = Orientation::from_exif(orientation).unwrap_or(Orientation::NoTransforms);
    let file_copies = match format {
        // The reader of EXIF keeps a copy of TIFF files.
        ImageFormat::Tiff => 2,
        _ => 1,
    };
    let budget = MemoryBudget {
        file_bytes: bytes.len() as u64 * file_copies,
        is_copied: max_long_side_px.is_none() && orientation != Orientation::NoTransforms,
    };
    let (stored, damage) = match format {
        ImageFormat::Jpeg => {
            let decoded = decode_jpeg(path, bytes, &budget, limits)?;
            (decoded.image, decoded.damage)
        }
        ImageFormat::Png | ImageFormat::Tiff | ImageFormat::WebP => {
            (decode_other(path, bytes, format, &budget, limits)?, None)
        }
        other => {
            return Err(PhotoError::Unsupported {
                path: path.into(),
                found: format!("a picture in the format {other:?}"),
            });
        }
    };
    let full_size_px = stored.dimensions();
    let stored = match max_long_side_px {
        Some(limit) => area::limit_long_side(stored, limit),
        None => stored,
    };
    let swaps = orientation.to_exif() >= 5;
    let mut image = DynamicImage::ImageRgb8(stored);
    image.apply_orientation(orientation);
    Ok(Decoded {
        image: image.into_rgb8(),
        full_size_px: if swaps {
            (full_size_px.1, full_size_px.0)
        } else {
            full_size_px
        },
        damage,
    })
}

fn decode_jpeg(
    path: &Path,
    bytes: &[u8],
    budget: &MemoryBudget,
    limits: &PhotoLimits,
) -> Result<DecodedJpeg, PhotoError> {
    let jpeg = Jpeg::read(bytes).map_err(|error| from_jpeg(path, error))?;
    budget.check(path, jpeg.size_px(), jpeg.memory_bytes_per_px(), limits)?;
    jpeg.decode().map_err(|error| from_jpeg(path, error))
}

fn from_jpeg(path: &Path, error: JpegError) -> PhotoError {
    let path = path.to_owned();
    match error {
        JpegError::Truncated(detail) => PhotoError::Truncated { path, detail },
        JpegError::Unsupported(found) => PhotoError::Unsupported { path, found },
        error => PhotoError::Corrupt {
            path,
            detail: error.to_string(),
        },
    }
}

fn decode_other(
    path: &Path,
    bytes: &[u8],
    format: ImageFormat,
    budget: &MemoryBudget,
    limits: &PhotoLimits,
) -> Result<RgbImage, PhotoError> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    if format == ImageFormat::Png {
        // Its reader decompresses the colour profile before the size of the picture is known here.
        let mut metadata_limits = image::Limits::default();
        metadata_limits.max_alloc = Some(MAX_PNG_METADATA_BYTES.min(limits.max_memory_bytes));
        reader.limits(metadata_limits);
    }
    let mut decoder = reader
        .into_decoder()
        .map_err(|error| from_image(path, error))?;
    let colour = decoder.color_type();
    // The decoder's picture, as much again in the decoder, and the 8-bit copy if it has another form.
    let copy = if colour == ColorType::Rgb8 { 0.0 } else { 3.0 };
    let bytes_per_px = 2.0 * f64::from(colour.bytes_per_pixel()) + copy;
    budget.check(path, decoder.dimensions(), bytes_per_px, limits)?;
    let mut decoder_limits = image::Limits::default();
    decoder_limits.max_alloc = Some(limits.max_memory_bytes);
    decoder
        .set_limits(decoder_limits)
        .map_err(|error| from_image(path, error))?;
    if matches!(colour, ColorType::Rgb32F | ColorType::Rgba32F) {
        return Err(PhotoError::Unsupported {
            path: path.into(),
            found: "a picture of floating-point samples".into(),
        });
    }
    let image = DynamicImage::from_decoder(decoder).map_err(|error| from_image(path, error))?;
    Ok(opaque_rgb(image))
}

/// 8-bit RGB; transparent pixels become black.
fn opaque_rgb(image: DynamicImage) -> RgbImage {
    if !image.color().has_alpha() {
        return image.into_rgb8();
    }
    let rgba = image.into_rgba8();
    let (width, height) = rgba.dimensions();
    let mut rgb = RgbImage::new(width, height);
    for (out, pixel) in rgb.pixels_mut().zip(rgba.pixels()) {
        let [r, g, b, alpha] = pixel.0;
        let fade = |sample: u8| ((u32::from(sample) * u32::from(alpha) + 127) / 255) as u8;
        out.0 = [fade(r), fade(g), fade(b)];
    }
    rgb
}

/// Converts an error of the decoder.
fn from_image(path: &Path, error: image::ImageError) -> PhotoError {
    let path = path.to_owned();
    match error {
        image::ImageError::Unsupported(error) => PhotoError::Unsupported {
            path,
            found: error.to_string(),
        },
        image::ImageError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            PhotoError::Truncated {
                path,
                detail: error.to_string(),
            }
        }
        error => PhotoError::Corrupt {
            path,
            detail: error.to_string(),
        },
    }
}
