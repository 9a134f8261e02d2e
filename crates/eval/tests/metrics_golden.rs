//! The figures against numpy's (`golden/make_golden.py`).

#![allow(clippy::unwrap_used)]

use std::path::Path;

use grimnet_eval::metrics::rank_distance::{FrameDistances, RankDistance, TileDistance};
use grimnet_eval::metrics::{Frame, ScoredFix, Summary};
use grimnet_geo::{LonLat, destination};
use grimnet_locate::internals::covariance::radius95;
use nalgebra::Matrix2;

const TRUTH: LonLat = LonLat {
    lon_deg: 13.4,
    lat_deg: 52.5,
};

fn frame(record: &csv::StringRecord) -> Frame {
    let number = |i: usize| record[i].parse::<f64>().ok();
    let scored = match (number(1), number(2)) {
        (Some(east), Some(north)) => {
            let [ee, en, nn] = [3, 4, 5].map(|i| number(i).unwrap());
            let bearing_deg = east.atan2(north).to_degrees();
            let fix = ScoredFix {
                position: destination(TRUTH, bearing_deg, east.hypot(north)),
                covariance_en_m2: [ee, en, nn],
                radius95_m: radius95(&Matrix2::new(ee, en, en, nn)),
            };
            Frame::score(&record[0], &fix, TRUTH)
        }
        _ => Frame::missed(&record[0], "not found"),
    };
    Frame {
        confidence: number(6),
        time_ms: number(7),
        ..scored
    }
}

#[test]
fn figures_are_numpys() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let mut reader = csv::Reader::from_path(folder.join("metrics_frames.csv")).unwrap();
    let frames: Vec<Frame> = reader.records().map(|r| frame(&r.unwrap())).collect();
    let summary = serde_json::to_value(Summary::of(&frames)).unwrap();
    let text = std::fs::read_to_string(folder.join("metrics_figures.json")).unwrap();
    let golden: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&text).unwrap();
    assert!(golden.len() > 20);
    for (name, expected) in &golden {
        let found = &summary[name];
        match expected.as_f64() {
            // Positions go over the ellipsoid and back: a millimetre in 150 m.
            Some(expected) => {
                let found = found.as_f64().unwrap();
                assert!(
                    (found - expected).abs() <= 1e-3 + 1e-5 * expected.abs(),
                    "{name}: {found}, numpy says {expected}"
                );
            }
            None => assert!(found.is_null(), "{name}: {found}, numpy says none"),
        }
    }
}

#[test]
fn distances_by_rank_are_numpys() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let text = std::fs::read_to_string(folder.join("retrieval_figures.json")).unwrap();
    let golden: serde_json::Value = serde_json::from_str(&text).unwrap();
    let list = |name: &str| -> Vec<f64> { serde_json::from_value(golden[name].clone()).unwrap() };
    let count = golden["frames"].as_u64().unwrap() as usize;
    let mut frames = vec![FrameDistances::default(); count];
    let mut reader = csv::Reader::from_path(folder.join("retrieval_tiles.csv")).unwrap();
    for record in reader.deserialize() {
        let (frame, tile_m, lon_deg, lat_deg): (usize, f64, f64, f64) = record.unwrap();
        let tile = TileDistance::of(LonLat { lon_deg, lat_deg }, tile_m, TRUTH);
        frames[frame].by_descriptor.push(tile);
        // The other way round, so that one order cannot pass for the other.
        frames[frame].by_vote.insert(0, tile);
    }
    let at: Vec<usize> = list("at").iter().map(|k| *k as usize).collect();
    let found = RankDistance::of(&frames, &at);
    for (name, found) in [
        ("sdm", &found.sdm_by_descriptor),
        ("pdm", &found.pdm_by_descriptor),
    ] {
        for (found, expected) in found.iter().zip(list(name)) {
            // numpy's metres are of the tangent plane: some millimetres in 100 m.
            assert!(
                (found - expected).abs() < 1e-5,
                "{name}: {found}, {expected}"
            );
        }
    }
    assert_ne!(found.sdm_by_vote, found.sdm_by_descriptor);
}
