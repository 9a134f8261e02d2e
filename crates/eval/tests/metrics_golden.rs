//! The figures against numpy's (`golden/make_golden.py`).

#![allow(clippy::unwrap_used)]

use std::path::Path;

use grimnet_eval::metrics::{Frame, ScoredFix, Summary};
use grimnet_geo::{LonLat, destination};
use grimnet_locate::covariance::radius95;
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
