//! Packs with random contents and right checksums: each is refused, or can be used without a panic.
//!
//! `PROPTEST_CASES` sets the number of inputs of each test (CONTRIBUTING.md, "Fuzzing").

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use std::path::Path;
use std::sync::OnceLock;

use grimnet_geo::{LevelPx, LonLat};
use grimnet_pack::{Pack, Reach};
use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::Value;
use support::forged::forged;
use support::{TestMap, indexed, make, paper, tiny_model};

/// Inputs of each test in a normal run.
const CASES: u32 = 64;

/// The bytes of a pack of each mode.
fn packs() -> &'static [Vec<u8>; 2] {
    static PACKS: OnceLock<[Vec<u8>; 2]> = OnceLock::new();
    PACKS.get_or_init(|| {
        [indexed(), paper()].map(|options| {
            let folder = tempfile::tempdir().unwrap();
            let out = folder.path().join("area.grim");
            make(&TestMap::new(900, 700), &options, &out).unwrap();
            std::fs::read(&out).unwrap()
        })
    })
}

/// Opens a pack and uses all of it.
fn check(path: &Path) {
    let pack = match Pack::open(path) {
        Ok(pack) => pack,
        Err(error) => {
            assert!(error.to_string().contains("area.grim"), "{error}");
            return;
        }
    };
    if pack.check_model(&tiny_model(1)).is_err() {
        return;
    }
    for level in pack.levels() {
        let [width, height] = level.size_px();
        let middle = LevelPx {
            x: width as f64 / 2.0,
            y: height as f64 / 2.0,
        };
        if let Ok(place) = level.lonlat_from_level_px(middle) {
            let _ = level.level_px_from_lonlat(place);
        }
        let _ = level.level_px_from_lonlat(LonLat {
            lon_deg: 9.0,
            lat_deg: 45.0,
        });
        for tile in 0..level.tile_count().min(20) {
            let info = level.tile(tile);
            let _ = level.tile_at(info.grid);
            let _ = level.blocks(tile);
            let _ = level.features(tile);
            let _ = level.strongest_features(tile, 10);
            assert_eq!(level.global(tile).len(), level.global_dim());
        }
        if let Some(index) = level.keypoint_index() {
            let reach = Reach {
                lists: 2,
                neighbours: 3,
            };
            let descriptor = vec![0.1; level.descriptor_dim()];
            index.search(&descriptor, reach, None, |found| {
                assert!(found.position.x.is_finite());
                let _ = level.tile_around(found.position);
            });
        }
        let _ = level.statistics();
    }
    let _ = pack.verify(&mut |_| {});
}

/// A value that a reader may stumble over.
fn value() -> impl Strategy<Value = Value> {
    prop_oneof![
        (0..70u64).prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<f64>().prop_map(Value::from),
        Just(Value::Null),
        Just(Value::from("")),
        Just(Value::from(true)),
        Just(Value::Array(vec![])),
    ]
}

/// All leaves of a JSON value, by path.
fn leaves(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(members) => {
            for (name, member) in members {
                leaves(member, &format!("{path}/{name}"), found);
            }
        }
        Value::Array(items) if !items.is_empty() => {
            for (i, item) in items.iter().enumerate() {
                leaves(item, &format!("{path}/{i}"), found);
            }
        }
        _ => found.push(path.to_owned()),
    }
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn manifests(
        mode in 0..2usize,
        changes in vec((any::<prop::sample::Index>(), value()), 1..3),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("area.grim");
        let change = |manifest: &mut Value| {
            let mut paths = Vec::new();
            leaves(manifest, "", &mut paths);
            for (index, value) in &changes {
                if let Some(leaf) = manifest.pointer_mut(index.get::<String>(&paths)) {
                    *leaf = value.clone();
                }
            }
        };
        std::fs::write(&path, forged(&packs()[mode], &change, &|_, _| {})).unwrap();
        check(&path);
    }

    #[test]
    fn sections(
        mode in 0..2usize,
        section in any::<prop::sample::Index>(),
        patches in vec((0.0..1.0f64, vec(any::<u8>(), 1..16)), 1..5),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("area.grim");
        let patch = |manifest: &Value, file: &mut [u8]| {
            let section = section.get(manifest["sections"].as_array().unwrap());
            let start = section["offset"].as_u64().unwrap() as usize;
            let len = section["len"].as_u64().unwrap() as usize;
            for (share, bytes) in &patches {
                let at = (share * len as f64) as usize;
                let bytes = &bytes[..bytes.len().min(len - at)];
                file[start + at..][..bytes.len()].copy_from_slice(bytes);
            }
        };
        std::fs::write(&path, forged(&packs()[mode], &|_| {}, &patch)).unwrap();
        check(&path);
    }
}
