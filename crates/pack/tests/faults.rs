//! Packs that are no packs, and places that cannot be written: refused, with what to do.

#![allow(clippy::unwrap_used)] // helpers outside of test functions fail the test that calls them

mod support;

use std::path::{Path, PathBuf};

use grimnet_pack::format::{FORMAT_VERSION, HEADER_LEN};
use grimnet_pack::{
    BuildLimits, BuildOptions, Levels, Pack, PackError, PackLimits, build_with_limits,
};
use support::forged::forged;
use support::*;

fn good() -> (tempfile::TempDir, PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    make(&TestMap::new(900, 700), &one_level(), &out).unwrap();
    let bytes = std::fs::read(&out).unwrap();
    (folder, out, bytes)
}

fn open(path: &Path, bytes: &[u8]) -> Result<Pack, PackError> {
    std::fs::write(path, bytes).unwrap();
    Pack::open(path)
}

#[test]
fn every_flipped_byte_is_noticed() {
    let (_folder, path, bytes) = good();
    open(&path, &bytes).unwrap();
    let manifest = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize;
    // All of header and manifest, and a sample of the rest.
    let places = (0..HEADER_LEN as usize)
        .chain(manifest..bytes.len())
        .chain((64..manifest).step_by(997));
    for at in places {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        let error = open(&path, &damaged).map(|_| at).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("area.grim") && text.contains("build"),
            "{at}: {text}"
        );
    }
}

#[test]
fn truncated_at_any_length() {
    let (_folder, path, bytes) = good();
    for len in [1, 7, 8, 20, 63, 64, 1000, bytes.len() / 2, bytes.len() - 1] {
        let error = open(&path, &bytes[..len]).unwrap_err();
        let expected = if len < 8 {
            "not a grimnet pack"
        } else {
            "truncated"
        };
        assert!(error.to_string().contains(expected), "{len}: {error}");
    }
    assert!(
        open(&path, &[])
            .unwrap_err()
            .to_string()
            .contains("truncated")
    );
    let longer = [&bytes[..], &[0]].concat();
    assert!(matches!(
        open(&path, &longer),
        Err(PackError::Corrupt { .. })
    ));
}

#[test]
fn other_versions_and_other_files() {
    let (_folder, path, bytes) = good();
    for version in [0, FORMAT_VERSION + 1] {
        let mut other = bytes.clone();
        other[8..12].copy_from_slice(&version.to_le_bytes());
        let error = open(&path, &other).unwrap_err();
        assert!(matches!(error, PackError::Version { found, .. } if found == version));
        assert!(
            error.to_string().contains("build the pack again"),
            "{error}"
        );
    }
    assert!(matches!(
        open(&path, &[b'x'; 5000]),
        Err(PackError::NotAPack { .. })
    ));
    assert!(matches!(
        Pack::open(path.parent().unwrap()),
        Err(PackError::NotAPack { .. } | PackError::Io { .. })
    ));
    let missing = Pack::open(path.with_file_name("nowhere.grim")).unwrap_err();
    assert!(missing.to_string().contains("check the path"), "{missing}");
}

fn section_of(manifest: &serde_json::Value, name: &str) -> usize {
    let sections = manifest["sections"].as_array().unwrap();
    let section = sections.iter().find(|s| s["name"] == name).unwrap();
    section["offset"].as_u64().unwrap() as usize
}

#[test]
fn a_consistent_file_with_impossible_references_is_refused() {
    let (_folder, path, bytes) = good();
    let rewrite =
        |change: &dyn Fn(&mut serde_json::Value)| open(&path, &forged(&bytes, change, &|_, _| {}));
    rewrite(&|_| {}).unwrap();
    let changes: [&dyn Fn(&mut serde_json::Value); 29] = [
        &|m| m["levels"][0]["tiles"] = 3.into(),
        &|m| m["levels"][0]["tiles"] = u64::MAX.into(),
        &|m| m["levels"][0]["unit_grid"] = serde_json::json!([1, 1]),
        &|m| m["levels"][0]["tile_grid"] = serde_json::json!([0, 0]),
        &|m| m["levels"][0]["tile_grid"] = serde_json::json!([u32::MAX, u32::MAX]),
        &|m| m["levels"][0]["unit_grid"] = serde_json::json!([u32::MAX, u32::MAX]),
        &|m| m["levels"][0]["frame"]["gsd_m"] = 0.into(),
        &|m| m["levels"][0]["frame"]["map_px_per_level_px_x"] = (-1).into(),
        &|m| m["levels"][0]["frame"]["width_px"] = u64::MAX.into(),
        &|m| m["levels"][0]["frame"]["height_px"] = 0.into(),
        &|m| m["levels"][0]["tile_px"] = u32::MAX.into(),
        &|m| m["levels"][0]["tile_px"] = 300.into(),
        &|m| m["levels"][0]["stride_px"] = 0.into(),
        &|m| m["levels"][0]["stride_px"] = u32::MAX.into(),
        &|m| m["levels"][0]["network_px"] = 0.into(),
        &|m| m["levels"][0]["units_per_tile_side"] = 0.into(),
        &|m| m["levels"][0]["units_per_tile_side"] = u32::MAX.into(),
        &|m| m["levels"][0]["origin_px"] = serde_json::json!([i64::MIN, i64::MAX]),
        &|m| m["levels"][0]["keypoints_per_unit"] = 1.into(),
        &|m| m["levels"][0]["keypoints_per_unit"] = u32::MAX.into(),
        &|m| m["levels"][0]["descriptor_scale"] = 0.into(),
        &|m| m["levels"][0]["keypoints"] = 1.into(),
        &|m| m["model"]["descriptor_dim"] = 1_000_000.into(),
        &|m| m["model"]["descriptor_dim"] = u64::MAX.into(),
        &|m| m["model"]["global_dim"] = 0.into(),
        &|m| m["map"]["georeference"]["affine"]["x_from_col"] = 0.into(),
        &|m| m["sections"][0]["offset"] = u64::MAX.into(),
        &|m| m["sections"][1]["name"] = "something else".into(),
        &|m| m["levels"] = serde_json::json!([]),
    ];
    for (i, change) in changes.iter().enumerate() {
        assert!(rewrite(change).is_err(), "change {i}");
    }
    let many = |m: &mut serde_json::Value| {
        let level = m["levels"][0].clone();
        m["levels"] = vec![level; 100].into();
    };
    let error = rewrite(&many).unwrap_err();
    assert!(error.to_string().contains("100 levels"), "{error}");
    // More keypoints than the section has bytes for, in the table of units.
    for keypoints in [u32::MAX, 257] {
        let file = forged(&bytes, &|_| {}, &|m, file| {
            let at = section_of(m, "0/units") + 8;
            file[at..at + 4].copy_from_slice(&keypoints.to_le_bytes());
        });
        assert!(open(&path, &file).is_err(), "{keypoints} keypoints");
    }
    // A scale that is not a number, in the table of scales.
    let file = forged(&bytes, &|_| {}, &|m, file| {
        let at = section_of(m, "0/global_scales");
        file[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    assert!(open(&path, &file).is_err());
}

#[test]
fn descriptors_of_another_dimension_than_the_models_are_refused() {
    let (_folder, path, bytes) = good();
    // Everything fits, since the features of fewer numbers fit into the same places.
    let change = |m: &mut serde_json::Value| m["model"]["descriptor_dim"] = 8.into();
    let pack = open(&path, &forged(&bytes, &change, &|_, _| {})).unwrap();
    let error = pack.check_model(&tiny_model(1)).unwrap_err();
    assert!(
        matches!(error, PackError::Corrupt { .. }) && error.to_string().contains("8 and 64"),
        "{error}"
    );
}

#[test]
fn control_characters_of_a_pack_are_not_printed() {
    let (_folder, path, bytes) = good();
    let change = |m: &mut serde_json::Value| {
        let evil = "x\u{1b}]0;title\u{7}\u{202e}\r\n";
        m["map"]["description"] = evil.into();
        m["model"]["preset"] = evil.into();
        m["model"]["hash"] = evil.into();
        m["levels"][0]["index_note"] = evil.into();
    };
    let pack = open(&path, &forged(&bytes, &change, &|_, _| {})).unwrap();
    let mismatch = pack.check_model(&tiny_model(1)).unwrap_err().to_string();
    for text in [pack.info().to_string(), mismatch] {
        let printed = |c: char| c == '\n' || !(c.is_control() || c == '\u{202e}');
        assert!(text.chars().all(printed), "{text:?}");
        assert!(text.contains("\\u{1b}]0;title"), "{text:?}");
    }
}

/// Limits with which features stay in the file and are verified on first use.
fn lazy() -> PackLimits {
    let mut limits = PackLimits::default();
    limits.copy_features_bytes = 0;
    limits.verify_at_open_bytes = 0;
    limits
}

/// A pack whose features take more than one block.
fn two_blocks() -> (tempfile::TempDir, PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let options = BuildOptions {
        keypoint_threshold: 0.0,
        max_keypoints: 2000,
        nms_radius_px: 0,
        ..one_level()
    };
    make(&TestMap::new(2048, 2048), &options, &out).unwrap();
    let bytes = std::fs::read(&out).unwrap();
    (folder, out, bytes)
}

#[test]
fn features_that_are_not_verified_at_open_are_verified_on_first_use() {
    let (_folder, path, bytes) = two_blocks();
    let eager = Pack::open(&path).unwrap();
    let features = eager.manifest().sections[0].clone();
    assert_eq!(features.name, "0/features");
    assert!(features.len > 1 << 20, "{} bytes", features.len);
    // The same features, wherever they are.
    let pack = Pack::open_with(&path, &lazy()).unwrap();
    let tiles = pack.levels()[0].tile_count();
    for i in 0..tiles {
        assert_eq!(
            pack.levels()[0].features(i).unwrap(),
            eager.levels()[0].features(i).unwrap()
        );
    }
    // One byte in the last block.
    let mut damaged = bytes.clone();
    damaged[(features.offset + features.len - 5000) as usize] ^= 1;
    std::fs::write(&path, &damaged).unwrap();
    assert!(matches!(Pack::open(&path), Err(PackError::Corrupt { .. })));
    let pack = Pack::open_with(&path, &lazy()).unwrap();
    let level = &pack.levels()[0];
    level.features(0).unwrap();
    let error = level.features(tiles - 1).map(|_| ()).unwrap_err();
    assert!(
        matches!(error, PackError::Corrupt { .. }) && error.to_string().contains("block at byte"),
        "{error}"
    );
    assert!(matches!(
        pack.verify(&mut |_| {}),
        Err(PackError::Corrupt { .. })
    ));
    // Features of the right bytes in another order.
    let mut shuffled = bytes.clone();
    let start = features.offset as usize;
    let (a, b) = shuffled[start..].split_at_mut(64 << 10);
    a.swap_with_slice(&mut b[..64 << 10]);
    std::fs::write(&path, &shuffled).unwrap();
    let pack = Pack::open_with(&path, &lazy()).unwrap();
    assert!(pack.levels()[0].features(0).is_err());
}

#[test]
fn a_pack_that_is_changed_while_it_is_open_gives_an_error() {
    let (_folder, path, bytes) = good();
    let write = |bytes: &[u8]| std::fs::write(&path, bytes).unwrap();
    let copied = Pack::open(&path).unwrap();
    let expected = copied.levels()[0].features(0).unwrap();
    // Truncated in place: the pages behind the end are gone.
    let pack = Pack::open_with(&path, &lazy()).unwrap();
    assert_eq!(pack.levels()[0].features(0).unwrap(), expected);
    write(&[]);
    let error = pack.levels()[0].features(0).unwrap_err();
    assert!(
        matches!(error, PackError::Changed { found: 0, .. }),
        "{error}"
    );
    assert!(pack.verify(&mut |_| {}).is_err());
    assert_eq!(
        pack.levels()[0]
            .search(&pack.levels()[0].global(3), 1, None)
            .unwrap()[0][0]
            .tile,
        3
    );
    // Overwritten with as many other bytes, after its features were verified.
    write(&bytes);
    let pack = Pack::open_with(&path, &lazy()).unwrap();
    pack.levels()[0].features(0).unwrap();
    let file = std::fs::File::options().write(true).open(&path).unwrap();
    let mut other = bytes.clone();
    other[64..5000].fill(7);
    std::io::Write::write_all(&mut &file, &other).unwrap();
    file.set_modified(std::time::SystemTime::now() + std::time::Duration::from_secs(5))
        .unwrap();
    let error = pack.levels()[0].features(0).unwrap_err();
    assert!(matches!(error, PackError::Corrupt { .. }), "{error}");
    // What was copied is as it was.
    assert_eq!(copied.levels()[0].features(0).unwrap(), expected);
    assert!(copied.verify(&mut |_| {}).is_err());
    // Replaced by renaming: the open pack stays as it was.
    write(&bytes);
    let pack = Pack::open_with(&path, &lazy()).unwrap();
    let new = path.with_extension("new");
    std::fs::write(&new, [b'x'; 100]).unwrap();
    std::fs::rename(&new, &path).unwrap();
    assert_eq!(pack.levels()[0].features(0).unwrap(), expected);
    pack.verify(&mut |_| {}).unwrap();
}

#[test]
fn tables_above_the_limit_are_refused() {
    let (_folder, path, _) = good();
    let mut limits = PackLimits::default();
    limits.max_table_bytes = 100;
    let error = Pack::open_with(&path, &limits).unwrap_err();
    assert!(matches!(error, PackError::TooLarge { limit: 100, .. }));
}

#[test]
fn plans_that_would_cost_too_much_are_refused_before_work_starts() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let at = |gsd_m: f64| BuildOptions {
        levels: Levels::Gsd(vec![gsd_m]),
        ..one_level()
    };
    let refused = |map: &TestMap, options: &BuildOptions, words: &[&str]| {
        let text = make(map, options, &out).unwrap_err().to_string();
        for word in words {
            assert!(text.contains(word), "{word}: {text}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    };
    let map = TestMap::new(900, 700);
    // A resolution at which the map is a single pixel.
    refused(&map, &at(1e7), &["1 x 1 px", "10000000"]);
    // So fine that the pack would not fit anywhere.
    refused(&map, &at(1e-4), &["tiles", "limit"]);
    refused(&map, &at(1e-9), &["px along a side"]);
    // Pixels of a nanometre, and of twenty kilometres.
    for (side, pixel_m) in [(4103, 1e-9), (9, 2e4)] {
        let map = TestMap::with_pixel(side, side, pixel_m);
        let auto = BuildOptions::standard();
        refused(&map, &auto, &["made-up map", "coordinate system"]);
    }
    let mut limits = BuildLimits::default();
    limits.max_pack_bytes = 1000;
    let error = build_with_limits(
        &map,
        &tiny_model(1),
        &one_level(),
        &limits,
        &out,
        &mut |_| {},
    )
    .unwrap_err();
    assert!(matches!(error, PackError::TooCostly { .. }), "{error}");
}

#[test]
fn an_output_that_is_no_file_is_refused_before_work_starts() {
    let folder = tempfile::tempdir().unwrap();
    let outputs = [folder.path(), Path::new("/dev/null")];
    for out in outputs.into_iter().filter(|out| out.exists()) {
        let error = make(&TestMap::new(900, 700), &one_level(), out).unwrap_err();
        assert!(matches!(error, PackError::NotAFile { .. }), "{error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn another_model_is_refused() {
    let (_folder, path, _) = good();
    let pack = Pack::open(&path).unwrap();
    pack.check_model(&tiny_model(1)).unwrap();
    let error = pack.check_model(&tiny_model(2)).unwrap_err();
    assert!(matches!(error, PackError::ModelMismatch { .. }));
    assert!(error.to_string().contains("use that model"), "{error}");
}

#[test]
fn a_blank_map_gives_no_pack() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    for blank in 0..2 {
        let mut map = TestMap::new(900, 700);
        if blank == 0 {
            map.nodata_left = 900;
        } else {
            map.black_top = 700;
        }
        let error = make(&map, &one_level(), &out).unwrap_err();
        assert!(matches!(error, PackError::Empty { .. }), "{error}");
        let text = error.to_string();
        assert!(
            text.contains("made-up map")
                && text.contains("coordinate")
                && !text.contains("area.grim"),
            "{text}"
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

#[test]
fn impossible_options_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let error = make(&TestMap::new(300, 900), &paper(), &out).unwrap_err();
    assert!(error.to_string().contains("smaller than a tile"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_says_so() {
    // Writing to this device fails as on a full disk.
    let mut writer = grimnet_pack::Writer::create(Path::new("/dev/full")).unwrap();
    let error = writer.section("x", &vec![0; 4 << 20]).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("free some space") && text.contains("the same command again"),
        "{text}"
    );
}

#[test]
#[cfg(target_os = "linux")]
fn a_folder_that_cannot_be_written_says_so() {
    // Nobody may make files there, not even the superuser.
    let error = make(
        &TestMap::new(900, 700),
        &one_level(),
        Path::new("/sys/area.grim"),
    )
    .unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("choose a folder that you may write to"),
        "{text}"
    );
    let missing = make(
        &TestMap::new(900, 700),
        &one_level(),
        Path::new("/nowhere/area.grim"),
    )
    .unwrap_err();
    assert!(missing.to_string().contains("check the path"), "{missing}");
}
