//! One resolution of a map in a TIFF file, and how its pixels are taken out.

use tiff_reader::{ColorModel, ExtraSample};

use crate::GeoError;
use crate::block::BlockLayout;
use crate::error::ADVICE_SAMPLES;
use crate::samples::{Bands, SampleKind, Samples};
use crate::tiff_compression::check_compression;
use crate::tiff_images::{TiffImage, TiffLevel};

/// Number of rows that thin strips are combined to.
const BAND_ROWS: u64 = 64;
/// Maximum size of combined strips, and of blocks of uncompressed ones, with all samples, bytes.
const MAX_BAND_BYTES: u64 = 32 << 20;
/// Side of the blocks in which uncompressed strips are read, if pixels have few samples.
const DIRECT_BLOCK_PX: u64 = 512;

/// How the pixels of an image are taken out of its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Access {
    /// The decoder's samples are the colours.
    Stored,
    /// The decoder must turn them into colours first: palette, YCbCr, CMYK, CIELab, fewer than 8
    /// bits.
    Converted,
    /// Uncompressed strips: any part of a row can be read where it lies.
    Direct,
}

/// One resolution of a map, and how it is read.
pub(crate) struct Level {
    pub image: TiffImage,
    pub mask: Option<TiffImage>,
    pub access: Access,
    pub kind: SampleKind,
    pub bands: Bands,
    /// Its colours are those of a palette.
    pub palette: bool,
    /// Bits by which the decoder's 16-bit colours of a palette are shifted to 8 bits; `None` where they have 8 already.
    palette_shift: Option<u32>,
    /// Samples as they are stored, which nodata is one of, where they are decoded to others: an index into a palette, or fewer bits.
    pub nodata_samples: Option<(SampleKind, Bands)>,
}

impl Level {
    /// How a resolution is read.
    ///
    /// # Errors
    /// Its compression, colours or samples are not read.
    pub fn new(level: &TiffLevel) -> Result<Self, GeoError> {
        let image = &level.image;
        for image in std::iter::once(image).chain(&level.mask) {
            check_compression(image)?;
        }
        let stored = image.ifd.raster_layout().map_err(|e| image.error(e))?;
        let model = image.ifd.color_model().map_err(|e| image.error(e))?;
        let (palette, needs_conversion) = match &model {
            ColorModel::Palette { .. } => (true, true),
            ColorModel::YCbCr { .. } | ColorModel::Cmyk { .. } | ColorModel::CieLab { .. } => {
                (false, true)
            }
            _ => (false, false),
        };
        let bit_packed = !matches!(stored.bits_per_sample, 8 | 16 | 32 | 64);
        let (access, layout) = if needs_conversion || bit_packed {
            let layout = image
                .ifd
                .decoded_raster_layout()
                .map_err(|e| image.error(e))?;
            (Access::Converted, layout)
        } else if image.can_read_direct(&stored) {
            (Access::Direct, stored)
        } else {
            (Access::Stored, stored)
        };
        // Writers store 8-bit colours times 257, for which the decoder gives 8 bits, times 256, or as they are.
        let palette_shift = match &model {
            ColorModel::Palette { color_map, .. } if layout.bytes_per_sample == 2 => {
                let planes = [color_map.red(), color_map.green(), color_map.blue()];
                let as_they_are = planes.iter().copied().flatten().all(|&value| value < 256);
                Some(if as_they_are { 0 } else { 8 })
            }
            _ => None,
        };
        let kind = match palette_shift {
            Some(_) => Some(SampleKind::U8),
            None => SampleKind::of(&layout),
        };
        let kind = kind.ok_or_else(|| GeoError::Unsupported {
            path: image.path.to_path_buf(),
            what: format!(
                "samples of {} bits, format {}",
                layout.bits_per_sample, layout.sample_format
            ),
            advice: ADVICE_SAMPLES,
        })?;
        let bands = bands_of(&model, layout.samples_per_pixel, access);
        let stored_bands = if palette {
            Some(Bands::first(stored.samples_per_pixel, 1, None))
        } else {
            // Alpha is looked at in the decoded samples.
            (bit_packed && !needs_conversion).then_some(Bands {
                count: stored.samples_per_pixel,
                alpha: None,
                ..bands
            })
        };
        Ok(Self {
            image: image.clone(),
            mask: level.mask.clone(),
            access,
            kind,
            bands,
            palette,
            palette_shift,
            nodata_samples: SampleKind::of(&stored).zip(stored_bands),
        })
    }

    /// The decoder's samples as those of [`Level::kind`].
    pub fn as_kind(&self, bytes: Vec<u8>) -> Vec<u8> {
        let Some(shift) = self.palette_shift else {
            return bytes;
        };
        bytes
            .chunks_exact(2)
            .map(|sample| (u16::from_ne_bytes([sample[0], sample[1]]) >> shift) as u8)
            .collect()
    }

    /// Samples as they were decoded, with their meaning.
    pub fn samples<'a>(&self, bytes: &'a [u8]) -> Samples<'a> {
        Samples {
            bytes,
            kind: self.kind,
            bands: self.bands,
        }
    }

    /// The blocks in which it is read.
    pub fn layout(&self) -> BlockLayout {
        let ifd = &self.image.ifd;
        let (width, height) = self.image.size();
        let pixel_bytes = (self.bands.count * self.kind.bytes()) as u64;
        let (block_w, block_h) = match (ifd.tile_width(), ifd.tile_height()) {
            (Some(w), Some(h)) if ifd.is_tiled() => (u64::from(w.max(1)), u64::from(h.max(1))),
            _ if self.access == Access::Direct => direct_block_px(pixel_bytes),
            _ => {
                let strip = u64::from(ifd.rows_per_strip().max(1)).min(height);
                let strips = (BAND_ROWS / strip).max(1);
                let affordable = MAX_BAND_BYTES / (strip * width * pixel_bytes.max(3)).max(1);
                (width, strip * strips.min(affordable.max(1)))
            }
        };
        BlockLayout {
            width,
            height,
            block_w,
            block_h,
        }
    }
}

/// Width and height of the blocks in which uncompressed strips are read: a pixel may have 65,535 samples.
fn direct_block_px(pixel_bytes: u64) -> (u64, u64) {
    let affordable = (MAX_BAND_BYTES / pixel_bytes.max(1)).max(1);
    let width = affordable.min(DIRECT_BLOCK_PX);
    (width, (affordable / width).min(DIRECT_BLOCK_PX))
}

fn bands_of(model: &ColorModel, count: usize, access: Access) -> Bands {
    let (color_bands, extra, inverted) = match model {
        ColorModel::Grayscale {
            white_is_zero,
            extra_samples,
        } => {
            // The converting decoder has already turned white and black round.
            (
                1,
                extra_samples.as_slice(),
                *white_is_zero && access != Access::Converted,
            )
        }
        ColorModel::Palette { extra_samples, .. }
        | ColorModel::Rgb { extra_samples }
        | ColorModel::Cmyk { extra_samples }
        | ColorModel::YCbCr { extra_samples, .. }
        | ColorModel::CieLab { extra_samples } => (3, extra_samples.as_slice(), false),
        ColorModel::Separated { extra_samples, .. } => (3, extra_samples.as_slice(), false),
        ColorModel::TransparencyMask => (1, [].as_slice(), false),
    };
    let first_extra = count.saturating_sub(extra.len());
    let alpha = extra
        .iter()
        .position(|e| {
            matches!(
                e,
                ExtraSample::AssociatedAlpha | ExtraSample::UnassociatedAlpha
            )
        })
        .map(|i| first_extra + i);
    // Files of three and more bands that call themselves grey are colours all the same.
    let without_alpha = count - usize::from(alpha.is_some());
    let color_bands = if without_alpha >= 3 { 3 } else { color_bands };
    Bands {
        inverted,
        ..Bands::first(count, color_bands.min(without_alpha), alpha)
    }
}
