//! Decoding compared with ffmpeg's (`tests/golden/make_golden.py`).

#[path = "../tests/golden/videos.rs"]
pub(crate) mod videos;

use std::fs::File;

use grimnet_limits::PhotoLimits;
use image::RgbImage;
use sha2::{Digest as _, Sha256};

use crate::Video;
use crate::decoder::Decoder;
use crate::movie::Movie;
use crate::picture::Picture;
use videos::{VIDEOS, golden};

const FRAMES_PER_S: f64 = 15.0;

fn hash(picture: &Picture) -> String {
    let mut bytes = Vec::new();
    match picture {
        Picture::H264 {
            hidden_px: (left, top),
            width,
            luma,
            blue,
            red,
            ..
        } => {
            for (plane, part) in [(luma, 1), (blue, 2), (red, 2)] {
                for row in plane.chunks(width.div_ceil(part)).skip(top / part) {
                    bytes.extend(&row[left / part..]);
                }
            }
        }
        Picture::H265(frame) => frame.write_yuv(&mut bytes),
    }
    let digest = Sha256::digest(&bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// All frames that are shown, in this order: time, hash of the planes, RGB.
fn all_frames(name: &str) -> Vec<(f64, String, RgbImage)> {
    let path = golden(name);
    let limits = PhotoLimits::DEFAULT;
    let mut video = Video::open(&path, &limits).unwrap();
    let mut file = File::open(&path).unwrap();
    let movie = Movie::read(&path, &mut file, &limits).unwrap();
    let mut decoder = Decoder::new(video.source.settings(&movie)).unwrap();
    let mut decoded = Vec::new();
    for sample in 0..movie.samples.len() {
        let bytes = video.source.read(&movie, sample).unwrap().to_vec();
        decoder.feed(sample, &bytes, true, &mut decoded).unwrap();
    }
    decoder.flush(&mut decoded);
    let mut shown: Vec<(f64, String, RgbImage)> = decoded
        .iter()
        .filter_map(|one| {
            let rgb = decoder.rgb(&one.picture).unwrap();
            let time_s = movie.shown_s[one.sample]?;
            Some((time_s, hash(&one.picture), movie.rotation.upright(rgb)))
        })
        .collect();
    shown.sort_by(|a, b| a.0.total_cmp(&b.0));
    shown
}

#[test]
fn times_and_samples_are_those_of_ffmpeg() {
    for name in VIDEOS {
        let text = fs_err::read_to_string(golden(name).with_extension("txt")).unwrap();
        let expected: Vec<(f64, &str)> = text
            .lines()
            .map(|line| line.split_once(' ').unwrap())
            .map(|(time, hash)| (time.parse().unwrap(), hash))
            .collect();
        let first_s = expected[0].0;
        let found = all_frames(name);
        assert_eq!(found.len(), expected.len(), "{name}");
        for ((time_s, hash, _), (expected_s, expected)) in found.iter().zip(&expected) {
            // ffmpeg counts fragments without an edit list by their own clock, and from the first frame where an edit list
            // begins between two frames.
            let since_first_s = expected_s - first_s;
            assert!(
                (time_s - found[0].0 - since_first_s).abs() < 1e-5,
                "{name} {time_s}"
            );
            assert_eq!(hash, expected, "{name} {time_s}");
        }
    }
}

/// To one level of 256: swscale calculates with other fixed-point numbers.
#[test]
fn colours_are_those_of_ffmpeg() {
    for name in VIDEOS {
        let expected = image::open(golden(name).with_extension("png")).unwrap();
        let expected = expected.to_rgb8();
        let frames = all_frames(name);
        let found = &frames[frames.len() / 2].2;
        assert_eq!(found.dimensions(), expected.dimensions(), "{name}");
        let differences = found.as_raw().iter().zip(expected.as_raw());
        let differences: Vec<u8> = differences.map(|(a, b)| a.abs_diff(*b)).collect();
        assert!(differences.iter().max() <= Some(&1), "{name}");
    }
}

/// Frames that are skipped change nothing in those that are taken.
#[test]
fn taken_frames_are_those_of_the_whole_video() {
    for name in VIDEOS {
        let all = all_frames(name);
        for frames_per_s in [FRAMES_PER_S, 7.5, 4.0, 1.7, 0.6] {
            let video = Video::open(golden(name), &PhotoLimits::DEFAULT).unwrap();
            let frames = video.at_rate(frames_per_s).unwrap();
            let count = frames.len();
            let taken: Vec<_> = frames.collect();
            assert_eq!(taken.len(), count, "{name}");
            let expected = ((all.len() - 1) as f64 / FRAMES_PER_S * frames_per_s).round() + 1.0;
            assert_eq!(count as f64, expected, "{name} at {frames_per_s}");
            for frame in taken {
                let whole = all.iter().find(|one| one.0 == frame.time_s).unwrap();
                let picture = frame.picture.unwrap();
                assert!(picture == whole.2, "{name} at {} s", frame.time_s);
            }
        }
    }
}
