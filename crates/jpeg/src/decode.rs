//! Decodes JPEG pictures, and finds damage of their compressed data.

use image::{DynamicImage, GrayImage, RgbImage};
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::damage::Damage;
use crate::error::JpegError;
use crate::reduced::{self, Reduction};
use crate::scan;
use crate::structure::JpegStructure;

/// A JPEG file whose headers were read.
#[derive(Debug)]
pub struct Jpeg<'a> {
    bytes: &'a [u8],
    structure: JpegStructure,
}

/// A decoded picture.
#[derive(Debug)]
pub struct DecodedJpeg {
    /// Its pixels.
    pub image: RgbImage,
    /// Damage that was found: part of the picture is wrong or shifted.
    pub damage: Option<Damage>,
}

impl<'a> Jpeg<'a> {
    /// Reads the headers up to the first scan.
    ///
    /// # Errors
    /// [`JpegError`] if they are damaged, end too early, or state a variant that is not supported.
    pub fn read(bytes: &'a [u8]) -> Result<Self, JpegError> {
        let structure = JpegStructure::read(bytes)?;
        let frame = &structure.frame;
        // The decoder takes the first scan of a baseline file for one of all colours where they differ in size.
        if structure.has_several_scans() && !frame.is_progressive && frame.max_sampling() != (1, 1)
        {
            return Err(JpegError::Unsupported(
                "a baseline JPEG with subsampled colours in several scans".into(),
            ));
        }
        Ok(Self { bytes, structure })
    }

    /// Width and height, px.
    #[must_use]
    pub fn size_px(&self) -> (u32, u32) {
        self.structure.frame.size_px
    }

    /// Memory for each pixel while decoding, bytes: the picture, and all coefficients (16 bits) if they come in several scans.
    #[must_use]
    pub fn memory_bytes_per_px(&self) -> f64 {
        let frame = &self.structure.frame;
        let picture = match frame.components.len() {
            // Grey is decoded first and then copied.
            1 => 4.0,
            _ => 3.0,
        };
        let coefficients = if self.structure.has_several_scans() {
            2.0 * frame.samples_per_px()
        } else {
            0.0
        };
        picture + coefficients
    }

    /// Memory for each pixel of the full size while decoding at reduced size, bytes: three pictures' worth of samples and coefficients
    /// of parts that are read side by side, half of which may be in vain, and the picture.
    #[must_use]
    pub fn reduced_memory_bytes_per_px(&self, reduction: Reduction) -> f64 {
        let kept = 1.0 / f64::from(reduction.divisor() * reduction.divisor());
        // Three samples of 16 bits; for each block, and there may be three for 64 px, a mean; for each MCU, a position.
        let of_parts = 6.0 * kept + 3.0 * 4.0 / 64.0 + 8.0 / 64.0;
        2.5 * of_parts + 3.0 * kept
    }

    /// Decodes the picture at reduced size: each pixel is the mean over its area. What cannot be reduced is decoded as by
    /// [`decode`](Self::decode), at full size: progressive files, those in several scans or of other colours than grey and YCbCr,
    /// and damaged ones.
    ///
    /// # Errors
    /// As [`decode`](Self::decode).
    pub fn decode_reduced(&self, reduction: Reduction) -> Result<DecodedJpeg, JpegError> {
        let (bytes, structure) = (self.bytes, &self.structure);
        structure.check_complete(bytes)?;
        if structure.frame.is_progressive || structure.has_other_colours {
            return self.decode();
        }
        match reduced::decode(
            bytes,
            &structure.frame,
            reduction,
            reduced::part_count(bytes),
        ) {
            Ok(Some(image)) => Ok(DecodedJpeg {
                image,
                damage: None,
            }),
            Ok(None) | Err(_) => self.decode(),
        }
    }

    /// Decodes the whole picture. Compare [`size_px`](Self::size_px) with what may be allocated first.
    ///
    /// The compressed data are checked beside the decoding: strictly by the decoder, and those of baseline files block by block.
    /// A damaged picture is decoded as far as possible.
    ///
    /// # Errors
    /// [`JpegError`] if the data end before the end-of-image marker, or nothing can be decoded.
    pub fn decode(&self) -> Result<DecodedJpeg, JpegError> {
        let (bytes, frame) = (self.bytes, &self.structure.frame);
        self.structure.check_complete(bytes)?;
        let (pixels, contradiction) = if frame.is_progressive {
            (decode_pixels(bytes, true), None)
        } else {
            rayon::join(|| decode_pixels(bytes, true), || scan::check(bytes, frame))
        };
        if let Some(image) = pixels? {
            return Ok(DecodedJpeg {
                image,
                damage: contradiction,
            });
        }
        let image = decode_pixels(bytes, false)?
            .ok_or_else(|| JpegError::Corrupt(Damage::Undecodable.to_string()))?;
        Ok(DecodedJpeg {
            image,
            damage: contradiction.or(Some(Damage::Undecodable)),
        })
    }
}

/// The pixels; `None` if strict decoding finds the compressed data contradictory.
fn decode_pixels(bytes: &[u8], is_strict: bool) -> Result<Option<RgbImage>, JpegError> {
    // Headers are read tolerantly: cameras write odd ones.
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::MAX)
        .set_max_height(usize::MAX);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder
        .decode_headers()
        .map_err(|error| from_decoder(&error))?;
    let out = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => ColorSpace::Luma,
        _ => ColorSpace::RGB,
    };
    decoder.set_options(
        options
            .jpeg_set_out_colorspace(out)
            .set_strict_mode(is_strict),
    );
    let inconsistent = || JpegError::Corrupt("its headers state no size".into());
    let (width, height) = decoder.dimensions().ok_or_else(inconsistent)?;
    let mut pixels = vec![0; decoder.output_buffer_size().ok_or_else(inconsistent)?];
    match decoder.decode_into(&mut pixels) {
        Ok(()) => {}
        Err(error @ DecodeErrors::Unsupported(_)) => return Err(from_decoder(&error)),
        Err(_) if is_strict => return Ok(None),
        Err(error) => return Err(from_decoder(&error)),
    }
    let (width, height) = (width as u32, height as u32);
    let image = match out {
        ColorSpace::Luma => GrayImage::from_raw(width, height, pixels).map(DynamicImage::from),
        _ => RgbImage::from_raw(width, height, pixels).map(DynamicImage::from),
    };
    Ok(Some(image.ok_or_else(inconsistent)?.into_rgb8()))
}

fn from_decoder(error: &DecodeErrors) -> JpegError {
    match error {
        DecodeErrors::Unsupported(scheme) => JpegError::Unsupported(format!("{scheme:?}")),
        error => JpegError::Corrupt(error.to_string()),
    }
}
