//! Damage of the compressed data of a JPEG is found, or does not move the picture.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod photo_files;

use std::path::Path;

use grimnet_photo::{Damage, Photo};
use image::RgbImage;
use photo_files::jpeg;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use rstest::rstest;

/// A picture with texture everywhere, the same for the same size.
fn textured(width: u32, height: u32) -> RgbImage {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    RgbImage::from_fn(width, height, |x, y| {
        let wave = 60.0 * ((f64::from(x) / 5.0).sin() + (f64::from(y) / 7.0).cos());
        let tone = (128.0 + wave) as u8 / 2 + random.random_range(0..64);
        image::Rgb([tone, tone.wrapping_add(20), 255 - tone])
    })
}

fn read(bytes: &[u8]) -> Photo {
    Photo::from_bytes("a.jpg", bytes, None).unwrap()
}

/// The positions of the compressed data: behind the header of the first scan, before the end marker.
fn scan_of(bytes: &[u8]) -> std::ops::Range<usize> {
    let header = bytes.windows(2).position(|w| w == [0xFF, 0xDA]).unwrap();
    let length = usize::from(u16::from_be_bytes([bytes[header + 2], bytes[header + 3]]));
    header + 2 + length..bytes.len() - 2
}

#[rstest]
fn whole_pictures_are_not_called_damaged(
    #[values((16, 16), (17, 31), (200, 150), (641, 479))] (width, height): (u32, u32),
    #[values(20, 75, 95, 100)] quality: u8,
) {
    let image = textured(width, height);
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality)
        .encode_image(&image)
        .unwrap();
    assert_eq!(read(&bytes).damage, None);
    let mut grey = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut grey, quality)
        .encode_image(&image::DynamicImage::from(image).into_luma8())
        .unwrap();
    assert_eq!(read(&grey).damage, None);
}

/// Files of another encoder (`golden/make_golden.py`): libjpeg-turbo, by Pillow.
#[rstest]
fn files_of_another_encoder_are_not_called_damaged(
    #[values("cmyk.jpg", "progressive.jpg", "subsampled.jpg", "restart.jpg")] file: &str,
) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(file);
    assert_eq!(Photo::open(path).unwrap().damage, None);
}

#[test]
fn missing_and_added_data_are_found() {
    let whole = jpeg(&textured(240, 160));
    let scan = scan_of(&whole);
    let middle = scan.start + scan.len() / 2;
    let mut cut = whole.clone();
    cut.drain(middle..middle + 400);
    assert!(read(&cut).damage.is_some());
    let mut doubled = whole.clone();
    doubled.splice(middle..middle, whole[middle..middle + 400].iter().copied());
    assert!(read(&doubled).damage.is_some());
    let mut zeroed = whole.clone();
    zeroed[middle..middle + 400].fill(0);
    assert!(read(&zeroed).damage.is_some());
    // Nothing left at all, and a photo is still returned.
    let mut empty = whole.clone();
    empty.drain(scan);
    assert_eq!(read(&empty).damage, Some(Damage::TooShort));
    // Two bytes of padding are what some encoders write.
    let mut padded = whole.clone();
    padded.splice(whole.len() - 2..whole.len() - 2, [0, 0]);
    assert_eq!(read(&padded).damage, None);
    padded.splice(whole.len() - 2..whole.len() - 2, [0; 8]);
    assert_eq!(read(&padded).damage, Some(Damage::TooLong));
}

#[test]
fn restart_markers_are_counted() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/restart.jpg");
    let whole = std::fs::read(path).unwrap();
    let markers: Vec<usize> = scan_of(&whole)
        .filter(|&at| whole[at] == 0xFF && (0xD0..=0xD7).contains(&whole[at + 1]))
        .collect();
    assert!(markers.len() > 4, "{}", markers.len());
    let mut missing = whole.clone();
    missing.drain(markers[1]..markers[2]);
    assert_eq!(read(&missing).damage, Some(Damage::RestartMarker));
    let mut swapped = whole;
    swapped[markers[1] + 1] = 0xD5;
    assert_eq!(read(&swapped).damage, Some(Damage::RestartMarker));
}

/// What a failing card or a bad transfer does: bits that flip, and runs of bytes that are lost or zero.
fn damaged(whole: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let scan = scan_of(whole);
    let mut bytes = whole.to_vec();
    let at = random.random_range(scan.start..scan.end - 64);
    match random.random_range(0..3) {
        0 => bytes[at] ^= 1 << random.random_range(0..8),
        1 => {
            bytes.drain(at..at + random.random_range(1..64));
        }
        _ => bytes[at..at + 64].fill(0),
    }
    bytes
}

#[test]
fn damage_that_is_not_found_does_not_shift_the_picture() {
    let whole = jpeg(&textured(240, 160));
    let before = read(&whole).image;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut undetected = 0;
    for _ in 0..200 {
        let bytes = damaged(&whole, &mut random);
        let Ok(photo) = Photo::from_bytes("a.jpg", &bytes, None) else {
            continue;
        };
        if photo.damage.is_some() {
            continue;
        }
        undetected += 1;
        // The last rows, which would be shifted, show the same texture: as tones relative to their mean, since a wrong mean
        // brightness of one block changes that of all blocks after it.
        let correlation = correlation_of_last_rows(&before, &photo.image);
        assert!(correlation > 0.9, "{correlation}");
    }
    // Mostly single bits of amplitudes, which change one block and no position.
    assert!(undetected < 80, "{undetected} of 200");
}

/// Pearson's correlation of the green samples of the last 40 rows.
fn correlation_of_last_rows(a: &RgbImage, b: &RgbImage) -> f64 {
    let samples = |image: &RgbImage| -> Vec<f64> {
        let (width, height) = image.dimensions();
        (height - 40..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| f64::from(image.get_pixel(x, y).0[1]))
            .collect()
    };
    let (a, b) = (samples(a), samples(b));
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (mean_a, mean_b) = (mean(&a), mean(&b));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(&b) {
        ab += (x - mean_a) * (y - mean_b);
        aa += (x - mean_a).powi(2);
        bb += (y - mean_b).powi(2);
    }
    ab / (aa * bb).sqrt()
}

#[test]
fn any_damage_of_a_progressive_file_gives_a_photo_or_an_error() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/progressive.jpg");
    let whole = std::fs::read(path).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut found = 0;
    for _ in 0..300 {
        let bytes = damaged(&whole, &mut random);
        match Photo::from_bytes("a.jpg", &bytes, None) {
            Ok(photo) => found += usize::from(photo.damage.is_some()),
            Err(_) => found += 1,
        }
    }
    assert!(found > 0, "no damage was found");
}
