//! Our SIFT beside OpenCV's, on a drawn and a photographed pair of pictures and on a rendered map and photo
//! (`golden/sift/make_golden.py`).

#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use grimnet_experiments::sift::{DESCRIPTOR_DIM, SiftFeatures, SiftKeypoint, SiftOptions, sift};
use grimnet_kernels::Isa;
use grimnet_locate::internals::matching::{Descriptors, Matcher};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden/sift")
        .join(name)
}

fn table(name: &str) -> Vec<Vec<f32>> {
    let text = std::fs::read_to_string(golden(name)).unwrap();
    let numbers = |line: &str| line.split(',').map(|t| t.parse().unwrap()).collect();
    text.lines().skip(1).map(numbers).collect()
}

fn ours(name: &str) -> SiftFeatures {
    let picture = image::open(golden(name)).unwrap().to_luma8();
    sift(&picture, &SiftOptions::default())
}

/// Difference of two angles, degrees.
fn turn_deg(a: f32, b: f32) -> f32 {
    ((a - b + 180.0).rem_euclid(360.0) - 180.0).abs()
}

/// Index of our keypoint that is OpenCV's: same place, scale and orientation.
fn same(ours: &[SiftKeypoint], theirs: &[f32]) -> Option<usize> {
    let [x, y, sigma, clockwise_deg] = theirs[..4] else {
        panic!("{theirs:?}");
    };
    ours.iter().position(|k| {
        (k.x_px - x).hypot(k.y_px - y) < 0.25
            && (k.sigma_px / sigma).ln().abs() < 0.05
            && turn_deg(k.orientation_deg, -clockwise_deg) < 4.0
    })
}

#[test]
fn keypoints_and_descriptors_are_those_of_opencv() {
    for (pair, name) in [
        ("drawn", "a"),
        ("drawn", "b"),
        ("photographed", "a"),
        ("photographed", "b"),
        ("rendered", "a"),
        ("rendered", "b"),
    ] {
        let ours = ours(&format!("{pair}_{name}.png"));
        let theirs = table(&format!("{pair}_keypoints_{name}.csv"));
        let bytes = std::fs::read(golden(&format!("{pair}_descriptors_{name}.bin"))).unwrap();
        assert_eq!(bytes.len(), theirs.len() * DESCRIPTOR_DIM);
        let mut similarities = Vec::new();
        for (keypoint, descriptor) in theirs.iter().zip(bytes.chunks_exact(DESCRIPTOR_DIM)) {
            let Some(i) = same(&ours.keypoints, keypoint) else {
                continue;
            };
            let length = descriptor
                .iter()
                .map(|&v| f32::from(v).powi(2))
                .sum::<f32>()
                .sqrt();
            let mine = &ours.descriptors[i * DESCRIPTOR_DIM..(i + 1) * DESCRIPTOR_DIM];
            let dot: f32 = mine
                .iter()
                .zip(descriptor)
                .map(|(a, &b)| a * f32::from(b))
                .sum();
            similarities.push(dot / length);
        }
        let found = similarities.len() as f32 / theirs.len() as f32;
        let close = similarities.iter().filter(|s| **s > 0.99).count() as f32;
        let close = close / similarities.len() as f32;
        let counts = (ours.keypoints.len(), theirs.len());
        assert!(found > 0.97, "{pair} {name}: {found} of {counts:?}");
        assert!(
            counts.0 as f32 <= 1.03 * counts.1 as f32,
            "{pair} {name}: {counts:?}"
        );
        assert!(close > 0.97, "{pair} {name}: {close}");
    }
}

/// Our matches of a pair, and how many of them are OpenCV's; with the number of OpenCV's.
fn matches_shared(pair: &str) -> (usize, usize, usize) {
    let (a, b) = (
        ours(&format!("{pair}_a.png")),
        ours(&format!("{pair}_b.png")),
    );
    let mut matches = Vec::new();
    Matcher::new(Isa::detect())
        .mutual(
            Descriptors::F32(&a.descriptors),
            Descriptors::F32(&b.descriptors),
            DESCRIPTOR_DIM,
            Some(0.8),
            &mut matches,
        )
        .unwrap();
    let theirs = table(&format!("{pair}_matches.csv"));
    let shared = matches
        .iter()
        .filter(|m| {
            let (p, q) = (
                &a.keypoints[m.query as usize],
                &b.keypoints[m.tile as usize],
            );
            theirs.iter().any(|t| {
                (t[0] - p.x_px).hypot(t[1] - p.y_px) < 1.0
                    && (t[2] - q.x_px).hypot(t[3] - q.y_px) < 1.0
            })
        })
        .count();
    (matches.len(), shared, theirs.len())
}

#[test]
fn pairs_are_matched_as_by_opencv() {
    // OpenCV's matches are not asked to be mutual, ours are: some of theirs are missing, more where few are right.
    for (pair, least_of_theirs) in [("drawn", 0.85), ("photographed", 0.85), ("rendered", 0.5)] {
        let (ours, shared, theirs) = matches_shared(pair);
        assert!(
            shared as f32 > 0.97 * ours as f32,
            "{pair}: {shared} of our {ours}"
        );
        assert!(
            ours as f32 > least_of_theirs * theirs as f32,
            "{pair}: {ours}, OpenCV's {theirs}"
        );
    }
}
