//! Pictures of a map: in files, and small ones on a terminal.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context, Result, bail};
use grimnet_geo::RasterPatch;
use grimnet_output::OutputPolicy;
use image::{ImageFormat, RgbImage};

use crate::own_pictures;

/// Formats in which pictures are written, by the ending of the name.
const FORMATS: [(&str, ImageFormat); 6] = [
    ("png", ImageFormat::Png),
    ("jpg", ImageFormat::Jpeg),
    ("jpeg", ImageFormat::Jpeg),
    ("webp", ImageFormat::WebP),
    ("tif", ImageFormat::Tiff),
    ("tiff", ImageFormat::Tiff),
];

/// Columns of the picture.
const COLUMNS: u32 = 48;

/// The format that the name of a picture asks for.
///
/// # Errors
/// Its ending is none of those that are written.
pub fn picture_format(path: &Path) -> Result<ImageFormat> {
    let ending = path.extension().unwrap_or_default();
    let found = FORMATS
        .iter()
        .find(|(known, _)| ending.eq_ignore_ascii_case(known));
    match found {
        Some((_, format)) => Ok(*format),
        None => bail!(
            "{}: expected the name of a picture, which ends in .png, .jpg, .webp or .tif",
            path.display()
        ),
    }
}

/// Writes a picture to a file.
///
/// # Errors
/// It cannot be written, or `policy` forbids it.
pub fn write_picture(
    picture: &RgbImage,
    format: ImageFormat,
    path: &Path,
    policy: &OutputPolicy,
) -> Result<()> {
    let bytes = own_pictures::encoded(picture, format)
        .with_context(|| format!("cannot encode {}", path.display()))?;
    policy.write(path, |file| file.write_all(&bytes))?;
    Ok(())
}

/// A picture in 24-bit colours: each character shows two pixels, one above the other. What has no data is left empty.
pub fn terminal_picture(patch: &RasterPatch) -> String {
    let (width, height) = patch.rgb.dimensions();
    let columns = COLUMNS.min(width);
    let rows = (height * columns / width.max(1)).max(1).div_ceil(2) * 2;
    let pixel = |column: u32, row: u32| {
        let x = (column * width / columns).min(width - 1);
        let y = (row * height / rows).min(height - 1);
        let seen = patch.valid.get_pixel(x, y).0[0] != 0;
        seen.then(|| patch.rgb.get_pixel(x, y).0)
    };
    let mut text = String::new();
    for row in (0..rows).step_by(2) {
        for column in 0..columns {
            let written = match (pixel(column, row), pixel(column, row + 1)) {
                (None, None) => write!(text, "\x1b[0m "),
                (Some([r, g, b]), None) => write!(text, "\x1b[0;38;2;{r};{g};{b}m▀"),
                (None, Some([r, g, b])) => write!(text, "\x1b[0;38;2;{r};{g};{b}m▄"),
                (Some([r, g, b]), Some([r2, g2, b2])) => {
                    write!(text, "\x1b[38;2;{r};{g};{b};48;2;{r2};{g2};{b2}m▀")
                }
            };
            debug_assert!(written.is_ok());
        }
        text.push_str("\x1b[0m\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, Luma, Rgb, RgbImage};

    #[test]
    fn upper_and_lower_pixels_and_those_without_data() {
        let mut rgb = RgbImage::new(2, 2);
        rgb.put_pixel(0, 0, Rgb([1, 2, 3]));
        rgb.put_pixel(0, 1, Rgb([4, 5, 6]));
        let mut valid = GrayImage::from_pixel(2, 2, Luma([255]));
        valid.put_pixel(1, 0, Luma([0]));
        valid.put_pixel(1, 1, Luma([0]));
        let text = terminal_picture(&RasterPatch { rgb, valid });
        assert_eq!(text, "\x1b[38;2;1;2;3;48;2;4;5;6m▀\x1b[0m \x1b[0m\n");
    }
}
