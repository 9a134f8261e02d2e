//! Plain pictures as maps: JPEG, PNG, WebP.

use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};

use grimnet_limits::MapLimits;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::GeoError;
use crate::block::{Block, BlockLayout, BlockSource};
use crate::error::ADVICE_TILE_IT;
use crate::map_form::{is_tiff_name, start_of};
use crate::picture_block::{block_of_picture, decode_jpeg};

/// Largest picture that is decoded, pixels (768 MiB as RGB): it must be in memory as a whole.
const MAX_PIXELS: u64 = MapLimits::DEFAULT.max_picture_px;

/// What files begin with, in small letters, that are often taken for maps, and what they are.
const NO_PICTURES: [(&[u8], &str); 4] = [
    // The magic of a pack (`grimnet-pack`).
    (
        b"grimpack",
        "it is a grimnet pack, which is built from a map",
    ),
    (
        b"version https://git-lfs",
        "it is a pointer of Git LFS, not the file itself: fetch that with git lfs pull",
    ),
    (
        b"<!doctype html",
        "it is a web page: a server may have sent an error page in place of the file",
    ),
    (
        b"<html",
        "it is a web page: a server may have sent an error page in place of the file",
    ),
];

/// What is wrong with a picture of another size than when it was opened.
const CHANGED: &str = "it changed while it was open";

/// A picture. It cannot be decoded in parts, so it is one block.
pub(crate) struct Picture {
    path: PathBuf,
    format: ImageFormat,
    is_grey: bool,
    layout: [BlockLayout; 1],
}

impl Picture {
    /// Opens a picture and reads its size and kind of colours, not its pixels.
    pub fn open(path: &Path) -> Result<Self, GeoError> {
        // By what it begins with: its name may be that of another format.
        let reader = File::open(path)
            .and_then(|file| ImageReader::new(BufReader::new(file)).with_guessed_format())
            .map_err(|e| GeoError::io(path, e))?;
        let not_a_map = |reason: String| GeoError::NotAMap {
            path: path.to_path_buf(),
            reason,
        };
        let format = match reader.format() {
            Some(f @ (ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::WebP)) => f,
            Some(other) => {
                return Err(not_a_map(format!(
                    "{other:?} pictures are not supported; {ADVICE_TILE_IT}"
                )));
            }
            None => return Err(not_a_map(kind_of_no_picture(path)?)),
        };
        let decoder = reader
            .into_decoder()
            .map_err(|e| GeoError::damaged(path, e))?;
        let is_grey = !decoder.color_type().has_color();
        let (width, height) = decoder.dimensions();
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
            is_grey,
            layout,
        })
    }

    /// Width and height, pixels.
    pub fn size_px(&self) -> (u64, u64) {
        (self.layout[0].width, self.layout[0].height)
    }

    /// Whether it has no colours.
    pub fn is_grey(&self) -> bool {
        self.is_grey
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

/// What a file without a picture is, by what it begins with.
fn kind_of_no_picture(path: &Path) -> Result<String, GeoError> {
    let start = start_of(path)?.to_ascii_lowercase();
    let known = NO_PICTURES
        .iter()
        .find(|(magic, _)| start.trim_ascii_start().starts_with(magic));
    Ok(match known {
        Some((_, kind)) => (*kind).to_string(),
        None if is_tiff_name(path.as_os_str()) => {
            "it does not begin as a TIFF file: it may be damaged, or of another format".to_string()
        }
        None => format!(
            "it is not a picture in a known format; if GDAL reads it (JPEG 2000, ECW, Imagine), {ADVICE_TILE_IT}"
        ),
    })
}

impl BlockSource for Picture {
    fn levels(&self) -> &[BlockLayout] {
        &self.layout
    }

    fn decode(&self, _level: usize, _column: u64, _row: u64) -> Result<Block, GeoError> {
        Ok(block_of_picture(self.decode_whole()?))
    }
}
