//! Plain pictures as maps: JPEG, PNG, WebP.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use grimnet_limits::MapLimits;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::GeoError;
use crate::block::{Block, BlockLayout, BlockSource};
use crate::error::ADVICE_TILE_IT;
use crate::picture_block::{block_of_picture, decode_jpeg};

/// Largest picture that is decoded, pixels (768 MiB as RGB): it must be in memory as a whole.
const MAX_PIXELS: u64 = MapLimits::DEFAULT.max_picture_px;

/// What is wrong with a picture of another size than when it was opened.
const CHANGED: &str = "it changed while it was open";

/// A picture. It cannot be decoded in parts, so it is one block.
pub(crate) struct Picture {
    path: PathBuf,
    format: ImageFormat,
    layout: [BlockLayout; 1],
}

impl Picture {
    /// Opens a picture and reads its size, not its pixels.
    pub fn open(path: &Path) -> Result<Self, GeoError> {
        let reader = ImageReader::open(path)
            .and_then(ImageReader::with_guessed_format)
            .map_err(|e| GeoError::io(path, e))?;
        let not_a_map = |reason: String| GeoError::NotAMap {
            path: path.to_path_buf(),
            reason,
        };
        let format = match reader.format() {
            Some(f @ (ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::WebP)) => f,
            Some(other) => return Err(not_a_map(format!("{other:?} pictures are not supported"))),
            None => {
                return Err(not_a_map(
                    "it is not a picture in a known format".to_string(),
                ));
            }
        };
        let (width, height) = reader
            .into_dimensions()
            .map_err(|e| GeoError::damaged(path, e))?;
        let (width, height) = (u64::from(width), u64::from(height));
        if width == 0 || height == 0 {
            return Err(GeoError::damaged(
                path,
                format!("its size is {width} x {height}"),
            ));
        }
        if width.saturating_mul(height) > MAX_PIXELS {
            return Err(GeoError::Unsupported {
                path: path.to_path_buf(),
                what: format!("a {format:?} picture of {width} x {height} pixels"),
                advice: ADVICE_TILE_IT,
            });
        }
        let layout = [BlockLayout {
            width,
            height,
            block_w: width,
            block_h: height,
        }];
        Ok(Self {
            path: path.to_path_buf(),
            format,
            layout,
        })
    }

    /// Width and height, pixels.
    pub fn size_px(&self) -> (u64, u64) {
        (self.layout[0].width, self.layout[0].height)
    }

    /// The name of its format.
    pub fn kind(&self) -> &'static str {
        match self.format {
            ImageFormat::Jpeg => "JPEG",
            ImageFormat::Png => "PNG",
            _ => "WebP",
        }
    }

    fn decode_whole(&self) -> Result<DynamicImage, GeoError> {
        let damaged = |e: image::ImageError| GeoError::damaged(&self.path, e);
        let bytes = std::fs::read(&self.path).map_err(|e| GeoError::io(&self.path, e))?;
        if self.format == ImageFormat::Jpeg {
            return self.decode_jpeg(&bytes);
        }
        let mut reader = ImageReader::with_format(Cursor::new(bytes), self.format);
        // 16-bit RGBA, and as much again for the decoder.
        let mut limits = Limits::default();
        limits.max_alloc = Some(MAX_PIXELS * 16);
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(damaged)?;
        let size = decoder.dimensions();
        if (u64::from(size.0), u64::from(size.1)) != self.size_px() {
            return Err(GeoError::damaged(&self.path, CHANGED));
        }
        DynamicImage::from_decoder(decoder).map_err(damaged)
    }

    fn decode_jpeg(&self, bytes: &[u8]) -> Result<DynamicImage, GeoError> {
        let is_as_opened = |(width, height): (u32, u32)| {
            if (u64::from(width), u64::from(height)) == self.size_px() {
                Ok(())
            } else {
                Err(CHANGED.to_owned())
            }
        };
        decode_jpeg(bytes, is_as_opened).map_err(|reason| GeoError::damaged(&self.path, reason))
    }
}

impl BlockSource for Picture {
    fn levels(&self) -> &[BlockLayout] {
        &self.layout
    }

    fn decode(&self, _level: usize, _column: u64, _row: u64) -> Result<Block, GeoError> {
        Ok(block_of_picture(self.decode_whole()?))
    }
}
