//! Decoding at reduced size, against libjpeg-turbo (`golden/make_golden.py`) and against means of the full size.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_jpeg::{Jpeg, Reduction};
use image::RgbImage;

const REDUCTIONS: [Reduction; 3] = [Reduction::Half, Reduction::Quarter, Reduction::Eighth];

fn golden(file: &str) -> Vec<u8> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden");
    std::fs::read(format!("{folder}/{file}")).unwrap()
}

fn reduced(bytes: &[u8], reduction: Reduction) -> RgbImage {
    let decoded = Jpeg::read(bytes)
        .unwrap()
        .decode_reduced(reduction)
        .unwrap();
    assert_eq!(decoded.damage, None);
    decoded.image
}

/// Largest and mean difference of the samples.
fn differences(a: &RgbImage, b: &RgbImage) -> (u8, f64) {
    assert_eq!(a.dimensions(), b.dimensions());
    let pairs = a.as_raw().iter().zip(b.as_raw());
    let differences: Vec<u8> = pairs.map(|(a, b)| a.abs_diff(*b)).collect();
    let sum: f64 = differences.iter().copied().map(f64::from).sum();
    let largest = differences.iter().copied().max().unwrap();
    (largest, sum / differences.len() as f64)
}

/// Luminance (ITU-T T.871).
fn luma(image: &RgbImage) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let [r, g, b] = image.get_pixel(x, y).0.map(f64::from);
        image::Rgb([(0.299 * r + 0.587 * g + 0.114 * b).round() as u8; 3])
    })
}

#[test]
fn pictures_are_those_of_libjpeg() {
    for name in ["444", "422", "420", "grey", "restart", "optimised"] {
        let bytes = golden(&format!("{name}.jpg"));
        for reduction in REDUCTIONS {
            let file = format!("{name}_{}.png", reduction.divisor());
            let expected = image::load_from_memory(&golden(&file)).unwrap().into_rgb8();
            let image = reduced(&bytes, reduction);
            let (largest, mean) = differences(&luma(&image), &luma(&expected));
            assert!(largest <= 1 && mean < 0.2, "{file}: {largest} {mean}");
            // libjpeg-turbo enlarges chrominance of 4:2:2 here, which this crate transforms to as many samples as there are pixels.
            if name == "422" {
                continue;
            }
            let (largest, mean) = differences(&image, &expected);
            assert!(largest <= 3 && mean < 0.3, "{file}: {largest} {mean}");
        }
    }
}

#[test]
fn pixels_are_means_over_their_areas() {
    for name in ["444", "422", "420", "grey", "optimised"] {
        let bytes = golden(&format!("{name}.jpg"));
        let full = Jpeg::read(&bytes).unwrap().decode().unwrap().image;
        for reduction in REDUCTIONS {
            let side = reduction.divisor();
            let image = reduced(&bytes, reduction);
            let mut sum = 0.0;
            let (columns, rows) = (full.width() / side, full.height() / side);
            for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
                for channel in 0..3 {
                    let area = (0..side * side).map(|i| {
                        full.get_pixel(x * side + i % side, y * side + i / side).0[channel]
                    });
                    let mean = area.map(f64::from).sum::<f64>() / f64::from(side * side);
                    sum += (mean - f64::from(image.get_pixel(x, y).0[channel])).abs();
                }
            }
            let mean = sum / f64::from(3 * columns * rows);
            assert!(mean < 1.0, "{name} 1/{side}: {mean}");
        }
    }
}

/// Components with the names R, G and B are no YCbCr, also without an Adobe segment: they come at full size.
#[test]
fn rgb_by_the_names_of_the_components_is_not_converted() {
    let mut bytes = golden("444.jpg");
    // Behind marker, length, precision, size and count there are three bytes for each component, and two in the scan's header.
    for (marker, behind, step) in [([0xFF, 0xC0], 10, 3), ([0xFF, 0xDA], 5, 2)] {
        let at = bytes.windows(2).position(|pair| pair == marker).unwrap();
        for (component, name) in b"RGB".iter().enumerate() {
            bytes[at + behind + step * component] = *name;
        }
    }
    let full = Jpeg::read(&bytes).unwrap().decode().unwrap().image;
    assert_eq!(reduced(&bytes, Reduction::Half), full);
}

#[test]
fn the_long_side_chooses_the_reduction() {
    let of = |min_long_side_px| Reduction::to_long_side((4000, 2250), min_long_side_px);
    assert_eq!(of(2048), None);
    assert_eq!(of(2000), Some(Reduction::Half));
    assert_eq!(of(1001), Some(Reduction::Half));
    assert_eq!(of(1000), Some(Reduction::Quarter));
    assert_eq!(of(500), Some(Reduction::Eighth));
    assert_eq!(of(0), Some(Reduction::Eighth));
    assert_eq!(Reduction::Quarter.size_px((4000, 2250)), (1000, 563));
}
