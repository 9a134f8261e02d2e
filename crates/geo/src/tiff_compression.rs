//! How the pixels in a TIFF file are compressed.

use tiff_reader::{ExtraSample, Ifd};

use crate::GeoError;
use crate::error::ADVICE_TILE_IT;
use crate::tiff_images::TiffImage;

const JPEG: u16 = 7;
const WEBP: u16 = 50001;
const LERC: u16 = 34887;
/// TIFF 6.0, PlanarConfiguration: the samples of a pixel lie together.
const CONTIGUOUS: u16 = 1;

/// Compressions that are read: number (TIFF tag 259, as TIFF 6.0 and libtiff's tiff.h have them) and name.
const READ: [(u16, &str); 9] = [
    (1, "uncompressed"),
    (5, "LZW"),
    (JPEG, "JPEG"),
    (8, "Deflate"),
    (32946, "Deflate"),
    (32773, "PackBits"),
    (LERC, "LERC"),
    (50000, "ZSTD"),
    (WEBP, "WebP"),
];

/// Others whose name helps.
const OTHERS: [(u16, &str); 9] = [
    (2, "CCITT"),
    (3, "CCITT"),
    (4, "CCITT"),
    (6, "JPEG of TIFF before 1995"),
    (34712, "JPEG 2000"),
    (34892, "lossy JPEG of DNG"),
    (34925, "LZMA"),
    (50002, "JPEG XL"),
    (52546, "JPEG XL"),
];

/// The compression with a number, for messages.
pub(crate) fn compression_name(number: u16) -> String {
    READ.iter()
        .chain(&OTHERS)
        .find(|(known, _)| *known == number)
        .map_or_else(
            || format!("compression {number}"),
            |(_, name)| (*name).to_owned(),
        )
}

/// Refuses an image whose pixels cannot be decompressed, before any work starts.
///
/// # Errors
/// Returns [`GeoError::Unsupported`], which says how to make a file that can be read.
pub(crate) fn check_compression(image: &TiffImage) -> Result<(), GeoError> {
    let refused = |what: String| GeoError::Unsupported {
        path: image.path.to_path_buf(),
        what,
        advice: ADVICE_TILE_IT,
    };
    let number = image.ifd.compression();
    if READ.iter().all(|(known, _)| *known != number) {
        let name = compression_name(number);
        return Err(refused(format!("pixels compressed as {name} ({number})")));
    }
    let samples = image.ifd.samples_per_pixel();
    let together = image.ifd.planar_configuration() == CONTIGUOUS;
    // Encoders leave out the alpha of tiles that are opaque, and the decoder expects it.
    if number == WEBP && samples != 3 {
        return Err(refused("WebP with alpha inside TIFF".to_owned()));
    }
    if number == LERC && has_lerc_mask(&image.ifd) {
        return Err(refused("LERC with 8-bit alpha inside TIFF".to_owned()));
    }
    // The decoder has no JPEG of two components, as grey with alpha is stored (also by GDAL's COG driver).
    if number == JPEG && together && samples == 2 {
        return Err(refused("JPEG of grey with alpha inside TIFF".to_owned()));
    }
    Ok(())
}

/// Whether libtiff (tif_lerc.c) stores the last sample as the mask of LERC, which the decoder does not give: 8-bit alpha that is not
/// multiplied into the colours.
fn has_lerc_mask(ifd: &Ifd) -> bool {
    let ends_with_alpha = ifd
        .extra_samples()
        .is_ok_and(|extra| extra.last() == Some(&ExtraSample::UnassociatedAlpha));
    let is_8_bit = ifd
        .bits_per_sample()
        .is_ok_and(|bits| bits.first() == Some(&8));
    ends_with_alpha && is_8_bit && ifd.planar_configuration() == CONTIGUOUS
}
