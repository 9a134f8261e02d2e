//! Each fault of a picture file gets a typed error that names it, or is read right.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "helpers of tests, outside of test functions"
)]

mod photo_files;

use std::path::Path;

use exif::Tag;
use grimnet_photo::{MIN_SIDE_PX, Metadata, Photo, PhotoError, PhotoLimits};
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage, RgbaImage};
use photo_files::{encoded, exif_app1, gradient, jpeg, short, with_app1};
use rstest::rstest;

fn read(bytes: &[u8]) -> Result<Photo, PhotoError> {
    Photo::from_bytes("frame_0042", bytes, None)
}

fn fault(bytes: &[u8]) -> PhotoError {
    let error = read(bytes).unwrap_err();
    assert!(error.to_string().contains("frame_0042"), "{error}");
    // Reading at reduced size finds the same fault.
    let reduced = Photo::from_bytes("frame_0042", bytes, Some(40)).unwrap_err();
    assert_eq!(
        std::mem::discriminant(&error),
        std::mem::discriminant(&reduced),
        "{error} / {reduced}"
    );
    error
}

#[rstest]
#[case::a_third(1, 3)]
#[case::three_quarters(3, 4)]
#[case::nearly_all(99, 100)]
fn a_truncated_file_is_called_truncated(
    #[case] num: usize,
    #[case] denom: usize,
    #[values(
        ImageFormat::Jpeg,
        ImageFormat::Png,
        ImageFormat::Tiff,
        ImageFormat::WebP
    )]
    format: ImageFormat,
) {
    let whole = encoded(&gradient(200, 150), format);
    assert!(read(&whole).is_ok());
    let error = fault(&whole[..whole.len() * num / denom]);
    assert!(
        matches!(
            error,
            PhotoError::Truncated { .. } | PhotoError::Corrupt { .. }
        ),
        "{error:?}"
    );
    if format == ImageFormat::Jpeg {
        assert!(matches!(error, PhotoError::Truncated { .. }), "{error:?}");
    }
}

#[test]
fn a_jpeg_that_ends_in_its_headers_or_before_its_end_marker_is_truncated() {
    let whole = jpeg(&gradient(200, 150));
    for length in [3, 20, 60, 300, whole.len() - 2, whole.len() - 1] {
        let error = fault(&whole[..length]);
        assert!(
            matches!(error, PhotoError::Truncated { .. }),
            "{length}: {error:?}"
        );
    }
}

#[test]
fn what_follows_the_end_marker_does_not_matter() {
    let mut bytes = jpeg(&gradient(64, 48));
    bytes.extend(b"a maker's trailer");
    assert!(read(&bytes).is_ok());
}

#[test]
fn damaged_headers_are_an_error_and_never_a_panic() {
    let whole = jpeg(&gradient(64, 48));
    let mut broken = whole.clone();
    broken[20..40].fill(0x55); // where the second segment should begin
    assert!(matches!(fault(&broken), PhotoError::Corrupt { .. }));
    // Every byte of the headers, damaged in turn: an error or a picture.
    for at in 0..whole.len().min(640) {
        for value in [0x00, 0xFF, whole[at] ^ 0x10] {
            let mut bytes = whole.clone();
            bytes[at] = value;
            let _ = read(&bytes);
            let _ = Photo::from_bytes("x", &bytes, Some(16));
        }
    }
}

#[test]
fn not_a_picture() {
    assert!(matches!(fault(b""), PhotoError::Empty { .. }));
    assert!(matches!(
        fault(b"hello, this is a text"),
        PhotoError::Unsupported { .. }
    ));
    assert!(matches!(
        fault(b"GIF89a\x01\0\x01\0\0\0\0;"),
        PhotoError::Unsupported { .. }
    ));
    let error = Photo::open("/nowhere/DJI_0001.JPG").unwrap_err();
    assert!(matches!(error, PhotoError::Read { .. }));
    assert!(error.to_string().contains("DJI_0001.JPG"));
    assert!(Photo::open(std::env::temp_dir()).is_err());
}

#[test]
fn a_format_that_is_not_read_is_named() {
    for (bytes, name) in [
        (&b"\0\0\0\x24ftypheic\0\0\0\0mif1heic"[..], "HEIC"),
        (b"\0\0\0\x18ftypcrx \0\0\0\x01crx isom", "CR3"),
        (b"\0\0\0\x0CJXL \r\n\x87\n\0\0\0\x14", "JPEG XL"),
        (b"\0\0\0\x0CjP  \r\n\x87\n\0\0\0\x14", "JPEG 2000"),
        (b"II\x2B\0\x08\0\0\0\x10\0\0\0", "BigTIFF"),
    ] {
        let error = fault(bytes).to_string();
        assert!(
            error.contains(&format!("a picture in the format {name}")),
            "{error}"
        );
    }
}

/// A copy with the frame header's size replaced.
fn claiming(jpeg: &[u8], width: u16, height: u16) -> Vec<u8> {
    let mut bytes = jpeg.to_vec();
    let frame = bytes.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
    bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
    bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
    bytes
}

#[test]
fn a_bomb_is_refused_before_it_is_allocated() {
    let small = jpeg(&gradient(64, 48));
    let error = fault(&claiming(&small, 65_500, 65_500));
    assert!(
        matches!(
            error,
            PhotoError::TooLarge {
                width_px: 65_500,
                ..
            }
        ),
        "{error:?}"
    );
    // Within the limit, but more than so few bytes can hold.
    assert!(matches!(
        fault(&claiming(&small, 16_000, 16_000)),
        PhotoError::Truncated { .. }
    ));
    // PNG: the size stands in the first chunk, which has a checksum.
    let mut png = encoded(&gradient(64, 48), ImageFormat::Png);
    png[16..20].copy_from_slice(&60_000u32.to_be_bytes());
    png[20..24].copy_from_slice(&60_000u32.to_be_bytes());
    let crc = crc32(&png[12..29]).to_be_bytes();
    png[29..33].copy_from_slice(&crc);
    assert!(matches!(fault(&png), PhotoError::TooLarge { .. }));
    // 34 bytes of lossless WebP that state 16383 x 16383 pixels (RFC 9649, 3.4: 14 bits each, less one).
    let mut webp = b"RIFF\x1a\0\0\0WEBPVP8L\x0d\0\0\0\x2f".to_vec();
    webp.extend((0x3FFE_u32 | 0x3FFE << 14).to_le_bytes());
    webp.resize(34, 0);
    assert!(matches!(
        fault(&webp),
        PhotoError::TooLarge {
            height_px: 16_383,
            ..
        }
    ));
}

#[rstest]
fn memory_is_limited_by_size_of_file_and_picture(
    #[values(
        ImageFormat::Jpeg,
        ImageFormat::Png,
        ImageFormat::Tiff,
        ImageFormat::WebP
    )]
    format: ImageFormat,
) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("DJI_0042");
    let bytes = encoded(&gradient(200, 150), format);
    std::fs::write(&path, &bytes).unwrap();
    let open = |max_memory_bytes: u64| {
        let mut limits = PhotoLimits::default();
        limits.max_memory_bytes = max_memory_bytes;
        Photo::open_with(&path, None, &limits)
    };
    let file_bytes = bytes.len() as u64;
    let error = open(file_bytes - 1).unwrap_err();
    assert!(
        matches!(error, PhotoError::FileTooLarge { .. }),
        "{error:?}"
    );
    let error = open(file_bytes + 3 * 200 * 150 - 1).unwrap_err();
    assert!(matches!(error, PhotoError::TooLarge { .. }), "{error:?}");
    assert!(error.to_string().contains("DJI_0042"), "{error}");
    // Never more than three copies of the file and of the picture.
    assert!(open(3 * (file_bytes + 3 * 200 * 150)).is_ok());
}

#[test]
fn a_file_beyond_the_limit_is_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.tif");
    // Sparse: 2.5 GB that take no room.
    let file = std::fs::File::create(&path).unwrap();
    file.set_len(2_500_000_000).unwrap();
    let error = Photo::open(&path).unwrap_err();
    assert_eq!(
        error.to_string(),
        format!(
            "{} has 2.3 GiB; the limit for a photo is 1 GiB (an orthophoto is a map: build a pack from it)",
            path.display()
        )
    );
    assert!(Metadata::read(&path).is_err());
}

/// CRC-32 of PNG (ISO 3309), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & 0u32.wrapping_sub(crc & 1));
        }
    }
    !crc
}

#[test]
fn no_pixels_and_one_pixel() {
    let error = fault(&jpeg(&RgbImage::new(1, 1)));
    assert!(
        matches!(error, PhotoError::TooSmall { width_px: 1, .. }),
        "{error:?}"
    );
    let zero = claiming(&jpeg(&gradient(64, 48)), 0, 0);
    assert!(matches!(
        fault(&zero),
        PhotoError::TooSmall { height_px: 0, .. }
    ));
    for format in [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::WebP] {
        let error = fault(&encoded(&RgbImage::new(1, 1), format));
        assert!(matches!(error, PhotoError::TooSmall { .. }), "{error:?}");
    }
    assert!(read(&jpeg(&gradient(MIN_SIDE_PX, MIN_SIDE_PX))).is_ok());
}

#[test]
fn one_bad_frame_leaves_the_next_unaffected() {
    let good = jpeg(&gradient(96, 64));
    let before = read(&good).unwrap().image;
    for bad in [&good[..good.len() / 2], b"nonsense"] {
        assert!(read(bad).is_err());
        assert_eq!(read(&good).unwrap().image, before);
    }
}

fn file_of(image: DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

#[rstest]
fn sixteen_bits_become_eight(#[values(ImageFormat::Png, ImageFormat::Tiff)] format: ImageFormat) {
    let deep = image::ImageBuffer::from_fn(40, 30, |x, y| {
        image::Rgb([(x * 1600) as u16, (y * 2000) as u16, 65_535])
    });
    let photo = read(&file_of(DynamicImage::ImageRgb16(deep), format)).unwrap();
    for (x, y, pixel) in photo.image.enumerate_pixels() {
        let eight = |v: u32| (f64::from(v) / 257.0).round() as u8;
        assert_eq!(pixel.0, [eight(x * 1600), eight(y * 2000), 255]);
    }
}

#[rstest]
fn grey_becomes_rgb(
    #[values(ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Jpeg)] format: ImageFormat,
) {
    let grey = GrayImage::from_fn(40, 32, |x, _| image::Luma([(x * 6) as u8]));
    let photo = read(&file_of(DynamicImage::ImageLuma8(grey), format)).unwrap();
    for (x, _, pixel) in photo.image.enumerate_pixels() {
        assert_eq!(pixel.0[0], pixel.0[1]);
        assert_eq!(pixel.0[0], pixel.0[2]);
        assert!(pixel.0[0].abs_diff((x * 6) as u8) <= 4);
    }
}

#[rstest]
fn what_is_transparent_is_black(
    #[values(ImageFormat::Png, ImageFormat::WebP)] format: ImageFormat,
) {
    let image = RgbaImage::from_fn(40, 30, |x, _| {
        image::Rgba([200, 100, 50, if x < 20 { 255 } else { 0 }])
    });
    let photo = read(&file_of(DynamicImage::ImageRgba8(image), format)).unwrap();
    assert_eq!(photo.image.get_pixel(19, 5).0, [200, 100, 50]);
    assert_eq!(photo.image.get_pixel(20, 5).0, [0, 0, 0]);
}

/// Files that Pillow wrote (golden/make_golden.py): the four colours in a palette, and the same in CMYK.
#[rstest]
#[case::palette("palette.png", 0)]
#[case::cmyk("cmyk.jpg", 12)]
#[case::progressive("progressive.jpg", 8)]
#[case::subsampled_chrominance("subsampled.jpg", 8)]
fn quarters_of_red_green_blue_white(#[case] file: &str, #[case] tolerance: u8) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(file);
    let photo = Photo::open_full(&path).unwrap();
    let (w, h) = photo.image.dimensions();
    assert_eq!((w, h), (64, 64));
    for (x, y, colour) in [
        (w / 4, h / 4, [255, 0, 0]),
        (3 * w / 4, h / 4, [0, 255, 0]),
        (w / 4, 3 * h / 4, [0, 0, 255]),
        (3 * w / 4, 3 * h / 4, [255, 255, 255]),
    ] {
        let got = photo.image.get_pixel(x, y).0;
        for (got, want) in got.into_iter().zip(colour) {
            assert!(
                got.abs_diff(want) <= tolerance,
                "{file} at {x},{y}: {got} {want}"
            );
        }
    }
}

#[rstest]
fn each_orientation_is_displayed_as_exif_means_it(
    #[values(1, 2, 3, 4, 5, 6, 7, 8)] orientation: u16,
    #[values(None, Some(48))] reduced: Option<u32>,
) {
    // EXIF 2.32, 4.6.4 (orientation): which side of the scene the stored row 0 and column 0 are.
    let (width, height) = (96u32, 64u32);
    let scene = gradient(width, height);
    let swaps = orientation >= 5;
    let stored_size = if swaps {
        (height, width)
    } else {
        (width, height)
    };
    let stored = RgbImage::from_fn(stored_size.0, stored_size.1, |column, row| {
        let (last_x, last_y) = (width - 1, height - 1);
        let (x, y) = match orientation {
            1 => (column, row),
            2 => (last_x - column, row), // row 0 top, column 0 right
            3 => (last_x - column, last_y - row), // bottom, right
            4 => (column, last_y - row), // bottom, left
            5 => (row, column),          // left, top
            6 => (last_x - row, column), // right, top
            7 => (last_x - row, last_y - column), // right, bottom
            _ => (row, last_y - column), // left, bottom
        };
        *scene.get_pixel(x, y)
    });
    let bytes = with_app1(
        &jpeg(&stored),
        &[exif_app1(&[(Tag::Orientation, short(orientation))])],
    );
    assert_eq!(
        u16::from(Metadata::from_bytes(&bytes).orientation),
        orientation
    );
    let photo = Photo::from_bytes("turned.jpg", &bytes, reduced).unwrap();
    assert_eq!(photo.full_size_px, (width, height));
    let factor = if reduced.is_some() { 2 } else { 1 };
    assert_eq!(photo.image.dimensions(), (width / factor, height / factor));
    for (x, y) in [(10, 8), (80, 8), (10, 50), (80, 50)] {
        let got = photo.image.get_pixel(x / factor, y / factor).0;
        let want = scene.get_pixel(x, y).0;
        for (got, want) in got.into_iter().zip(want) {
            assert!(
                got.abs_diff(want) <= 10,
                "{orientation} at {x},{y}: {got} {want}"
            );
        }
    }
}

#[test]
fn an_orientation_that_is_none_is_taken_as_upright_and_noted() {
    let bytes = with_app1(
        &jpeg(&gradient(96, 64)),
        &[exif_app1(&[(Tag::Orientation, short(77))])],
    );
    let photo = read(&bytes).unwrap();
    assert_eq!(photo.metadata.orientation, 1);
    assert_eq!(photo.image.dimensions(), (96, 64));
    assert!(photo.metadata.notes.iter().any(|note| note.value == "77"));
}

#[test]
fn floating_point_samples_are_refused() {
    let image = image::Rgb32FImage::new(40, 30);
    let bytes = file_of(DynamicImage::ImageRgb32F(image), ImageFormat::Tiff);
    assert!(matches!(fault(&bytes), PhotoError::Unsupported { .. }));
}

/// A TIFF file with one more entry of its first directory: tag, type (3 SHORT, 4 LONG) and one number.
fn with_tiff_entry(tiff: &[u8], tag: u16, kind: u16, value: u32) -> Vec<u8> {
    assert_eq!(&tiff[..2], b"II");
    let directory = u32::from_le_bytes(tiff[4..8].try_into().unwrap()) as usize;
    let count = usize::from(u16::from_le_bytes(
        tiff[directory..directory + 2].try_into().unwrap(),
    ));
    let entries = &tiff[directory + 2..directory + 2 + 12 * count];
    let mut entries: Vec<Vec<u8>> = entries.chunks(12).map(<[u8]>::to_vec).collect();
    let mut entry = [tag.to_le_bytes(), kind.to_le_bytes()].concat();
    entry.extend(1_u32.to_le_bytes());
    entry.extend(value.to_le_bytes());
    entries.push(entry);
    entries.sort_by_key(|entry| [entry[1], entry[0]]);
    // The new directory, on an even byte, is the last thing in the file.
    let mut bytes = tiff.to_vec();
    bytes.resize(tiff.len().next_multiple_of(2), 0);
    let at = u32::try_from(bytes.len()).unwrap();
    bytes[4..8].copy_from_slice(&at.to_le_bytes());
    bytes.extend((entries.len() as u16).to_le_bytes());
    bytes.extend(entries.concat());
    bytes.extend([0; 4]);
    bytes
}

#[rstest]
#[case::new_subfile_type(254, 4, 1, "thumbnail")]
#[case::old_subfile_type(255, 3, 2, "thumbnail")]
#[case::dng(50706, 4, 0x0000_0401, "raw photo")]
fn a_thumbnail_is_not_taken_for_the_photo(
    #[case] tag: u16,
    #[case] kind: u16,
    #[case] value: u32,
    #[case] words: &str,
) {
    let tiff = encoded(&gradient(160, 120), ImageFormat::Tiff);
    let error = fault(&with_tiff_entry(&tiff, tag, kind, value));
    assert!(matches!(error, PhotoError::Unsupported { .. }), "{error:?}");
    let text = error.to_string();
    assert!(
        text.contains(words) && text.contains("save it as JPEG"),
        "{text}"
    );
    // A page of several is the photo.
    assert!(read(&with_tiff_entry(&tiff, 254, 4, 2)).is_ok());
    // CR2: the same first bytes, with a mark.
    let mut raw = with_tiff_entry(&tiff, 254, 4, 0);
    raw[8..10].copy_from_slice(b"CR");
    assert!(fault(&raw).to_string().contains("raw photo"));
}
