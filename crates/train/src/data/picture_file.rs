//! Picture files, read within a limit on memory.

use super::picture::Picture;
use grimnet_limits::PhotoLimits;
use image::error::{LimitError, LimitErrorKind};
use image::{ImageDecoder as _, ImageError, ImageReader, ImageResult};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Memory that the limit leaves beside the file, bytes.
fn budget_bytes(path: &Path, limits: PhotoLimits) -> ImageResult<u64> {
    let file_bytes = std::fs::metadata(path)?.len();
    limits
        .max_memory_bytes
        .checked_sub(file_bytes)
        .ok_or_else(too_large)
}

fn too_large() -> ImageError {
    ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory))
}

fn reader(path: &Path, budget_bytes: u64) -> ImageResult<ImageReader<BufReader<File>>> {
    let mut reader = ImageReader::open(path)?;
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(budget_bytes);
    reader.limits(limits);
    Ok(reader)
}

/// Width and height in pixels, by the header.
///
/// # Errors
/// The file cannot be read, is no picture, or needs more memory than the limit.
pub fn size_px(path: &Path, limits: PhotoLimits) -> ImageResult<(u32, u32)> {
    let budget_bytes = budget_bytes(path, limits)?;
    let decoder = reader(path, budget_bytes)?.into_decoder()?;
    if decoder.total_bytes() > budget_bytes {
        return Err(too_large());
    }
    Ok(decoder.dimensions())
}

/// The picture; `None`, with a warning that says why, if it cannot be decoded within the limit.
pub fn open(path: &Path, limits: PhotoLimits) -> Option<Picture> {
    let decoded = budget_bytes(path, limits)
        .and_then(|budget_bytes| reader(path, budget_bytes))
        .and_then(ImageReader::decode);
    match decoded {
        Ok(image) => Some(Picture::new(image.into_rgb8())),
        Err(error) => {
            tracing::warn!(path = %path.display(), %error, "picture cannot be decoded and is skipped");
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    #[test]
    fn a_picture_beyond_the_limit_is_neither_listed_nor_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        RgbImage::from_pixel(800, 500, Rgb([1, 2, 3]))
            .save(&path)
            .unwrap();
        let file_bytes = std::fs::metadata(&path).unwrap().len();
        let needed_bytes = file_bytes + 3 * 800 * 500;
        for (limit_bytes, is_read) in [
            (0, false),
            (file_bytes - 1, false),
            (needed_bytes - 1, false),
            (PhotoLimits::DEFAULT.max_memory_bytes, true),
        ] {
            let limits = PhotoLimits::of_memory(limit_bytes);
            assert_eq!(size_px(&path, limits).is_ok(), is_read, "{limit_bytes}");
            assert_eq!(open(&path, limits).is_some(), is_read, "{limit_bytes}");
        }
        let limits = PhotoLimits::of_memory(needed_bytes);
        assert_eq!(size_px(&path, limits).unwrap(), (800, 500));
    }
}
