//! At what size photos are decoded.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod photo_files;

use grimnet_photo::{Metadata, Photo, PhotoLimits, QUERY_LONG_SIDE_PX};
use image::RgbImage;
use photo_files::jpeg;
use rstest::rstest;

fn waves(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let wave = |along: u32, px: f64| 60.0 * (f64::from(along) / px).sin();
        let tone = (128.0 + wave(x, 31.0) + wave(y, 43.0)) as u8;
        image::Rgb([tone, tone / 2 + 60, 255 - tone])
    })
}

fn as_needed(bytes: &[u8], needed_px: u32, limits: &PhotoLimits) -> Photo {
    let needed = |_: &Metadata, full_size_px: (u32, u32)| {
        assert_eq!(full_size_px, (2400, 1776));
        needed_px
    };
    Photo::from_bytes_as_needed("a.jpg", bytes, limits, needed).unwrap()
}

#[rstest]
#[case(1201, (2048, 1516))]
#[case(1200, (1200, 888))]
#[case(601, (1200, 888))]
#[case(600, (600, 444))]
#[case(300, (300, 222))]
#[case(0, (300, 222))]
fn jpegs_have_the_smallest_size_that_suffices(
    #[case] needed_px: u32,
    #[case] expected_px: (u32, u32),
) {
    let scene = waves(2400, 1776);
    let photo = as_needed(&jpeg(&scene), needed_px, &PhotoLimits::DEFAULT);
    assert_eq!(photo.full_size_px, (2400, 1776));
    assert_eq!(photo.image.dimensions(), expected_px);
    if expected_px.0 > 1200 {
        return;
    }
    let factor = 2400 / expected_px.0;
    for (x, y, pixel) in photo.image.enumerate_pixels().step_by(1009) {
        let area = (0..factor * factor).map(|i| {
            let (column, row) = (x * factor + i % factor, y * factor + i / factor);
            f64::from(scene.get_pixel(column, row).0[0])
        });
        let mean = area.sum::<f64>() / f64::from(factor * factor);
        assert!((f64::from(pixel.0[0]) - mean).abs() < 10.0, "{x},{y}");
    }
}

#[test]
fn other_formats_and_photos_within_the_limit_keep_their_size() {
    let mut png = std::io::Cursor::new(Vec::new());
    waves(2400, 60)
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    let limits = PhotoLimits::DEFAULT;
    let photo = Photo::from_bytes_as_needed("a.png", png.get_ref(), &limits, |_, _| 50).unwrap();
    assert_eq!(photo.image.dimensions(), (2048, 51));
    let small = jpeg(&waves(2000, 60));
    let photo = Photo::from_bytes_as_needed("a.jpg", &small, &limits, |_, _| 50).unwrap();
    assert_eq!(photo.image.dimensions(), (2000, 60));
}

#[test]
fn no_side_is_longer_than_queries_need() {
    let bytes = jpeg(&waves(2 * QUERY_LONG_SIDE_PX + 80, 80));
    let photo =
        Photo::from_bytes_as_needed("a.jpg", &bytes, &PhotoLimits::DEFAULT, |_, _| u32::MAX);
    assert_eq!(photo.unwrap().image.dimensions(), (QUERY_LONG_SIDE_PX, 39));
}

/// Decoding at half size takes more memory than at full size.
#[test]
fn within_little_memory_photos_are_decoded_at_full_size() {
    let bytes = jpeg(&waves(2400, 1776));
    let limits = PhotoLimits::of_memory(2400 * 1776 * 3 + bytes.len() as u64);
    let size_px = |needed_px| as_needed(&bytes, needed_px, &limits).image.dimensions();
    assert_eq!(size_px(1200), (2048, 1516));
    assert_eq!(size_px(600), (600, 444));
}
