//! Videos whose pixels are not square (`pixel_aspect/make_videos.sh`).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use grimnet_limits::PhotoLimits;
use grimnet_video::{Video, VideoError, VideoInfo};
use image::RgbImage;

/// Name, aspect, size as coded and with square pixels.
type Case = (&'static str, (u32, u32), (u32, u32), (u32, u32));
const VIDEOS: [Case; 2] = [
    ("h264_7_5", (7, 5), (80, 64), (112, 64)),
    ("h265_10_11", (10, 11), (64, 80), (64, 88)),
];

fn file(name: &str, ending: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/pixel_aspect")
        .join(name)
        .with_extension(ending)
}

/// What a video of these bytes says of itself, and its third frame.
fn third_frame(bytes: &[u8]) -> Result<(VideoInfo, RgbImage), VideoError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mp4");
    fs_err::write(&path, bytes).unwrap();
    let video = Video::open(&path, &PhotoLimits::DEFAULT)?;
    let info = video.info().clone();
    let picture = video.at_rate(15.0)?.nth(2).unwrap().picture?;
    Ok((info, picture))
}

/// The bytes of a video with its box `pasp` replaced; it has one.
fn with_pasp(name: &str, kind: &[u8; 4], aspect: (u32, u32)) -> Vec<u8> {
    let mut bytes = fs_err::read(file(name, "mp4")).unwrap();
    let at = bytes.windows(4).position(|four| four == b"pasp").unwrap();
    let body = [aspect.0.to_be_bytes(), aspect.1.to_be_bytes()].concat();
    bytes[at..at + 4].copy_from_slice(kind);
    bytes[at + 4..at + 12].copy_from_slice(&body);
    bytes
}

#[test]
fn pictures_have_square_pixels() {
    for (name, aspect, _, square_px) in VIDEOS {
        let expected = image::open(file(name, "png")).unwrap().to_rgb8();
        assert_eq!(expected.dimensions(), square_px);
        // The container states it; the stream alone.
        for kind in [b"pasp", b"free"] {
            let (info, picture) = third_frame(&with_pasp(name, kind, aspect)).unwrap();
            assert_eq!(info.pixel_aspect, Some(aspect), "{name}");
            assert_eq!(
                (info.size_px, picture.dimensions()),
                (square_px, square_px),
                "{name}"
            );
            let differences = picture.as_raw().iter().zip(expected.as_raw());
            let sum: u32 = differences.map(|(a, b)| u32::from(a.abs_diff(*b))).sum();
            let mean = f64::from(sum) / picture.as_raw().len() as f64;
            // ffmpeg stretches before it makes RGB.
            assert!(mean < 0.5, "{name}: {mean} levels from ffmpeg's");
        }
    }
}

#[test]
fn the_container_counts_more_than_the_stream() {
    for (name, _, coded_px, _) in VIDEOS {
        let (info, picture) = third_frame(&with_pasp(name, b"pasp", (1, 2))).unwrap();
        assert_eq!(info.pixel_aspect, Some((1, 2)), "{name}");
        assert_eq!(picture.dimensions(), (coded_px.0, 2 * coded_px.1), "{name}");
        let (info, picture) = third_frame(&with_pasp(name, b"pasp", (1, 1))).unwrap();
        assert_eq!(info.pixel_aspect, None, "{name}");
        assert_eq!(picture.dimensions(), coded_px, "{name}");
    }
}

#[test]
fn an_aspect_that_cannot_be_right_is_refused_by_name() {
    for (name, ..) in VIDEOS {
        let error = third_frame(&with_pasp(name, b"pasp", (65_535, 1))).unwrap_err();
        assert!(!error.is_unsupported(), "{error}");
        let text = error.to_string();
        assert!(
            text.contains("flight.mp4") && text.contains("65535:1"),
            "{text}"
        );
    }
}
