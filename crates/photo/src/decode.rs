//! From a photo file to 8-bit RGB, sizes checked before anything is allocated.

use std::io::Cursor;
use std::path::Path;

use grimnet_jpeg::{Damage, DecodedJpeg, Jpeg, JpegError, Reduction};
use grimnet_limits::PhotoLimits;
use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, RgbImage};

use crate::area;
use crate::budget::MemoryBudget;
use crate::error::PhotoError;
use crate::tiff_directory::why_not_the_photo;

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

/// At what size a file is decoded.
#[derive(Clone, Copy)]
pub(crate) struct DecodedSize<'a> {
    /// The long side is reduced to this, px; `None` for no limit.
    pub max_long_side_px: Option<u32>,
    /// The least long side that serves as well, px, for a picture of this width and height as displayed. Decoders that can leave
    /// out work come as near to it as they can.
    pub needed_long_side_px: &'a dyn Fn((u32, u32)) -> u32,
}

/// Decodes a file's bytes.
pub(crate) fn decode(
    path: &Path,
    bytes: &[u8],
    orientation: u8,
    size: DecodedSize<'_>,
    limits: &PhotoLimits,
) -> Result<Decoded, PhotoError> {
    if bytes.is_empty() {
        return Err(PhotoError::Empty { path: path.into() });
    }
    let format = image::guess_format(bytes).map_err(|_| PhotoError::Unsupported {
        path: path.into(),
        found: match format_by_signature(bytes) {
            Some(name) => format!("a picture in the format {name}"),
            None => "not a picture (unknown file signature)".into(),
        },
    })?;
    let orientation = Orientation::from_exif(orientation).unwrap_or(Orientation::NoTransforms);
    let file_copies = match format {
        // The reader of EXIF keeps a copy of TIFF files.
        ImageFormat::Tiff => 2,
        _ => 1,
    };
    let budget = MemoryBudget {
        file_bytes: bytes.len() as u64 * file_copies,
        is_copied: size.max_long_side_px.is_none() && orientation != Orientation::NoTransforms,
    };
    let swaps = orientation.to_exif() >= 5;
    let displayed = |(width, height)| {
        if swaps {
            (height, width)
        } else {
            (width, height)
        }
    };
    let (stored, stored_size_px, damage) = match format {
        ImageFormat::Jpeg => {
            let jpeg = Jpeg::read(bytes).map_err(|error| from_jpeg(path, error))?;
            let full_px = jpeg.size_px();
            let needed_px = || {
                let needed_px = (size.needed_long_side_px)(displayed(full_px));
                needed_px.min(size.max_long_side_px.unwrap_or(u32::MAX))
            };
            let decoded = decode_jpeg(path, &jpeg, needed_px, &budget, limits)?;
            (decoded.image, full_px, decoded.damage)
        }
        ImageFormat::Png | ImageFormat::Tiff | ImageFormat::WebP => {
            if format == ImageFormat::Tiff
                && let Some(found) = why_not_the_photo(bytes)
            {
                return Err(PhotoError::Unsupported {
                    path: path.into(),
                    found: found.into(),
                });
            }
            let image = decode_other(path, bytes, format, &budget, limits)?;
            let size_px = image.dimensions();
            (image, size_px, None)
        }
        other => {
            return Err(PhotoError::Unsupported {
                path: path.into(),
                found: format!("a picture in the format {other:?}"),
            });
        }
    };
    let stored = match size.max_long_side_px {
        Some(limit) => area::limit_long_side(stored, limit),
        None => stored,
    };
    let mut image = DynamicImage::ImageRgb8(stored);
    image.apply_orientation(orientation);
    Ok(Decoded {
        image: image.into_rgb8(),
        full_size_px: displayed(stored_size_px),
        damage,
    })
}

/// Formats of pictures that the decoders do not know: their signatures, where these begin, and their names.
const OTHER_FORMATS: [(usize, &[u8], &str); 10] = [
    // ISO 14496-12, 4.3: size, `ftyp`, brand.
    (4, b"ftypheic", "HEIC"),
    (4, b"ftypheix", "HEIC"),
    (4, b"ftypmif1", "HEIF"),
    (4, b"ftypcrx ", "CR3 (a raw photo)"),
    // ISO 18181-2, 9.1: the box of a container, and the bare codestream.
    (4, b"JXL \r\n\x87\n", "JPEG XL"),
    (0, b"\xFF\x0A", "JPEG XL"),
    // ISO 15444-1, I.5.1 and A.4.1.
    (4, b"jP  \r\n\x87\n", "JPEG 2000"),
    (0, b"\xFF\x4F\xFF\x51", "JPEG 2000"),
    (0, b"II\x2B\0", "BigTIFF"),
    (0, b"MM\0\x2B", "BigTIFF"),
];

/// The name of a format that is not read, by the first bytes of its files.
fn format_by_signature(bytes: &[u8]) -> Option<&'static str> {
    let begins =
        |at: usize, with: &[u8]| bytes.get(at..).is_some_and(|rest| rest.starts_with(with));
    let found = OTHER_FORMATS
        .iter()
        .find(|(at, signature, _)| begins(*at, signature));
    found.map(|(_, _, name)| *name)
}

/// Decodes a JPEG at the smallest size with a long side of at least `needed_px`.
fn decode_jpeg(
    path: &Path,
    jpeg: &Jpeg<'_>,
    needed_px: impl FnOnce() -> u32,
    budget: &MemoryBudget,
    limits: &PhotoLimits,
) -> Result<DecodedJpeg, PhotoError> {
    // A file that cannot be decoded at reduced size is decoded at its own.
    budget.check(path, jpeg.size_px(), jpeg.memory_bytes_per_px(), limits)?;
    let reduction = Reduction::to_long_side(jpeg.size_px(), needed_px()).filter(|&reduction| {
        let bytes_per_px = jpeg.reduced_memory_bytes_per_px(reduction);
        budget.needed_bytes(jpeg.size_px(), bytes_per_px) <= limits.max_memory_bytes
    });
    let decoded = match reduction {
        Some(reduction) => jpeg.decode_reduced(reduction),
        None => jpeg.decode(),
    };
    decoded.map_err(|error| from_jpeg(path, error))
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
            found: format!("its compression or colours are not read ({error})"),
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
