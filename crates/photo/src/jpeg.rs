//! Decodes JPEG pictures, and finds damage of their compressed data.

use std::path::Path;

use grimnet_limits::PhotoLimits;
use image::{DynamicImage, GrayImage, RgbImage};
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::budget::MemoryBudget;
use crate::damage::Damage;
use crate::error::PhotoError;
use crate::jpeg_scan;
use crate::jpeg_structure::JpegStructure;

/// A whole picture.
pub(crate) struct DecodedJpeg {
    pub image: RgbImage,
    pub damage: Option<Damage>,
}

/// Decodes the whole picture. Scaled decoding (DCT scaling by 1/8 to 1/2 in crate jpeg-decoder) took 0.85 to 1.1 times as long
/// as this decoder on drone photos, so the picture is decoded at full size and averaged.
///
/// The compressed data are checked beside the decoding: strictly by the decoder, and those of baseline files block by block.
/// A damaged picture is decoded as far as possible.
pub(crate) fn decode(
    path: &Path,
    bytes: &[u8],
    budget: &MemoryBudget,
    limits: &PhotoLimits,
) -> Result<DecodedJpeg, PhotoError> {
    let structure = JpegStructure::read(path, bytes)?;
    let frame = &structure.frame;
    budget.check(path, frame.size_px, bytes_per_px(&structure), limits)?;
    structure.check_complete(path, bytes)?;
    let (pixels, contradiction) = if frame.is_progressive {
        (decode_pixels(path, bytes, true), None)
    } else {
        rayon::join(
            || decode_pixels(path, bytes, true),
            || jpeg_scan::check(bytes, frame),
        )
    };
    match pixels? {
        Some(image) => Ok(DecodedJpeg {
            image,
            damage: contradiction,
        }),
        None => {
            let image = decode_pixels(path, bytes, false)?.ok_or_else(|| PhotoError::Corrupt {
                path: path.into(),
                detail: Damage::Undecodable.to_string(),
            })?;
            Ok(DecodedJpeg {
                image,
                damage: contradiction.or(Some(Damage::Undecodable)),
            })
        }
    }
}

/// Memory for each pixel while decoding: the picture, and all coefficients (16 bits) if they come in several scans.
fn bytes_per_px(structure: &JpegStructure) -> f64 {
    let frame = &structure.frame;
    let keeps_coefficients =
        frame.is_progressive || structure.first_scan_components < frame.components.len();
    let picture = match frame.components.len() {
        // Grey is decoded first and then copied.
        1 => 4.0,
        _ => 3.0,
    };
    let coefficients = if keeps_coefficients {
        2.0 * frame.samples_per_px()
    } else {
        0.0
    };
    picture + coefficients
}

/// The pixels; `None` if strict decoding finds the compressed data contradictory.
fn decode_pixels(
    path: &Path,
    bytes: &[u8],
    is_strict: bool,
) -> Result<Option<RgbImage>, PhotoError> {
    // Headers are read tolerantly: cameras write odd ones.
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder
        .decode_headers()
        .map_err(|error| from_decoder(path, &error))?;
    let out = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => ColorSpace::Luma,
        _ => ColorSpace::RGB,
    };
    decoder.set_options(
        options
            .jpeg_set_out_colorspace(out)
            .set_strict_mode(is_strict),
    );
    let inconsistent = || PhotoError::Corrupt {
        path: path.into(),
        detail: "its headers state no size".into(),
    };
    let (width, height) = decoder.dimensions().ok_or_else(inconsistent)?;
    let mut pixels = vec![0; decoder.output_buffer_size().ok_or_else(inconsistent)?];
    match decoder.decode_into(&mut pixels) {
        Ok(()) => {}
        Err(error @ DecodeErrors::Unsupported(_)) => return Err(from_decoder(path, &error)),
        Err(_) if is_strict => return Ok(None),
        Err(error) => return Err(from_decoder(path, &error)),
    }
    let (width, height) = (width as u32, height as u32);
    let image = match out {
        ColorSpace::Luma => GrayImage::from_raw(width, height, pixels).map(DynamicImage::from),
        _ => RgbImage::from_raw(width, height, pixels).map(DynamicImage::from),
    };
    Ok(Some(image.ok_or_else(inconsistent)?.into_rgb8()))
}

fn from_decoder(path: &Path, error: &DecodeErrors) -> PhotoError {
    let path = path.to_owned();
    match error {
        DecodeErrors::Unsupported(scheme) => PhotoError::Unsupported {
            path,
            found: format!("{scheme:?}"),
        },
        error => PhotoError::Corrupt {
            path,
            detail: error.to_string(),
        },
    }
}
