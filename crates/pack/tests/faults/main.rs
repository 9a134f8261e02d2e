//! Packs that are no packs, and places that cannot be written: refused, with what to do.

#![allow(clippy::unwrap_used)] // helpers outside of test functions fail the test that calls them

mod damaged;
mod late_damage;
#[path = "../support/mod.rs"]
mod support;

use std::path::{Path, PathBuf};

use grimnet_pack::format::{FORMAT_VERSION, HEADER_LEN};
use grimnet_pack::{
    BuildLimits, BuildOptions, Levels, Pack, PackError, PackLimits, build_with_limits,
};
use support::forged::forged;
use support::*;

fn good() -> (tempfile::TempDir, PathBuf, Vec<u8>) {
    good_of(&one_level())
}

fn good_of(options: &BuildOptions) -> (tempfile::TempDir, PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    make(&TestMap::new(900, 700), options, &out).unwrap();
    let bytes = std::fs::read(&out).unwrap();
    (folder, out, bytes)
}

fn open(path: &Path, bytes: &[u8]) -> Result<Pack, PackError> {
    std::fs::write(path, bytes).unwrap();
    Pack::open(path)
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
    // Tables above the limit of those who open it.
    limits.max_tiles = u64::MAX;
    limits.max_pack_bytes = u64::MAX;
    let fine = at(1e-4);
    let error = build_with_limits(&map, &tiny_model(1), &fine, &limits, &out, &mut |_| {});
    let text = error.unwrap_err().to_string();
    assert!(text.contains("bytes of tables"), "{text}");
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
