//! Pictures that this program draws, with a mark by which it knows them: a folder of photos may hold some.

use std::fs::File;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::codecs::tiff::TiffEncoder;
use image::codecs::webp::WebPEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat, ImageResult, RgbImage};

/// EXIF of a drawing: one directory with the field `Software` (CIPA DC-008-2019, 4.6.4), little endian. The text begins at byte 26.
const EXIF: &[u8] =
    b"II*\0\x08\0\0\0\x01\0\x31\x01\x02\0\x10\0\0\0\x1a\0\0\0\0\0\0\0grimnet drawing\0";

/// Where the mark is looked for: EXIF is at the beginning of a JPEG and a PNG, and at the end of a WebP, bytes.
const LOOKED_AT: u64 = 256;

/// A picture as a file with the mark. TIFF has no place for it.
///
/// # Errors
/// The format is none of JPEG, PNG, WebP and TIFF, or does not hold a picture of this size.
pub fn encoded(picture: &RgbImage, format: ImageFormat) -> ImageResult<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    match format {
        ImageFormat::Jpeg => write(JpegEncoder::new(&mut bytes), picture)?,
        ImageFormat::Png => write(PngEncoder::new(&mut bytes), picture)?,
        ImageFormat::WebP => write(WebPEncoder::new_lossless(&mut bytes), picture)?,
        ImageFormat::Tiff => write(TiffEncoder::new(&mut bytes), picture)?,
        _ => picture.write_to(&mut bytes, format)?,
    }
    Ok(bytes.into_inner())
}

fn write(mut encoder: impl ImageEncoder, picture: &RgbImage) -> ImageResult<()> {
    // A picture without the mark is as good to look at.
    let _ = encoder.set_exif_metadata(EXIF.to_vec());
    let (width, height) = picture.dimensions();
    encoder.write_image(picture, width, height, ExtendedColorType::Rgb8)
}

/// Whether a file has the mark. One that cannot be read has none: whoever opens it says why.
pub fn is_own(path: &Path) -> bool {
    let ends = || -> std::io::Result<[Vec<u8>; 2]> {
        let mut file = File::open(path)?;
        let len = file.metadata()?.len();
        let (mut head, mut tail) = (Vec::new(), Vec::new());
        (&file).take(LOOKED_AT).read_to_end(&mut head)?;
        file.seek(SeekFrom::Start(len.saturating_sub(LOOKED_AT)))?;
        file.take(LOOKED_AT).read_to_end(&mut tail)?;
        Ok([head, tail])
    };
    let has_mark = |part: &Vec<u8>| part.windows(EXIF.len()).any(|window| window == EXIF);
    ends().is_ok_and(|ends| ends.iter().any(has_mark))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawings_are_known_and_other_pictures_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let picture = RgbImage::from_fn(300, 200, |x, y| image::Rgb([x as u8, y as u8, 90]));
        for (name, format, is_marked) in [
            ("a.jpg", ImageFormat::Jpeg, true),
            ("a.png", ImageFormat::Png, true),
            ("a.webp", ImageFormat::WebP, true),
            ("a.tif", ImageFormat::Tiff, false),
        ] {
            let path = folder.path().join(name);
            fs_err::write(&path, encoded(&picture, format).unwrap()).unwrap();
            assert_eq!(is_own(&path), is_marked, "{name}");
            assert_eq!(image::open(&path).unwrap().width(), 300, "{name}");
            picture.save(&path).unwrap();
            assert!(!is_own(&path), "{name}");
        }
        assert!(!is_own(&folder.path().join("gone.jpg")));
    }
}
