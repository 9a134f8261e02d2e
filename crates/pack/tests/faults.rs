//! Packs that are no packs, and places that cannot be written: refused, with what to do.

#![allow(clippy::unwrap_used)] // helpers outside of test functions fail the test that calls them

mod support;

use std::path::{Path, PathBuf};

use grimnet_pack::format::{FORMAT_VERSION, HEADER_LEN};
use grimnet_pack::{Check, Pack, PackError};
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
            text.contains("area.grim") && text.contains("grim map build"),
            "{at}: {text}"
        );
    }
    // A damaged descriptor is harmless to read, and found when asked.
    let mut damaged = bytes.clone();
    damaged[100] ^= 1;
    std::fs::write(&path, &damaged).unwrap();
    let pack = Pack::open_checked(&path, Check::AllButFeatures).unwrap();
    assert!(matches!(pack.verify(), Err(PackError::Corrupt { .. })));
    for i in 0..pack.levels()[0].tile_count() {
        pack.levels()[0].features(i);
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
            "cut short"
        };
        assert!(error.to_string().contains(expected), "{len}: {error}");
    }
    assert!(
        open(&path, &[])
            .unwrap_err()
            .to_string()
            .contains("cut short")
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
            error.to_string().contains("run `grim map build` again"),
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

#[test]
fn a_consistent_file_with_impossible_references_is_refused() {
    // Whoever can write a pack can also write its checksums: references are checked for themselves.
    let (_folder, path, bytes) = good();
    let at = |i: usize| u64::from_le_bytes(bytes[i..i + 8].try_into().unwrap()) as usize;
    let (start, json) = (at(16), &bytes[at(16)..]);
    let manifest: serde_json::Value = serde_json::from_slice(json).unwrap();
    let rewrite = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut manifest = manifest.clone();
        change(&mut manifest);
        let json = serde_json::to_vec(&manifest).unwrap();
        let mut file = bytes[..start].to_vec();
        file[24..32].copy_from_slice(&(json.len() as u64).to_le_bytes());
        file[32..64].copy_from_slice(blake3::hash(&json).as_bytes());
        file.extend_from_slice(&json);
        open(&path, &file)
    };
    rewrite(&|_| {}).unwrap();
    let changes: [&dyn Fn(&mut serde_json::Value); 9] = [
        &|m| m["levels"][0]["tiles"] = 3.into(),
        &|m| m["levels"][0]["unit_grid"] = serde_json::json!([1, 1]),
        &|m| m["levels"][0]["tile_grid"] = serde_json::json!([0, 0]),
        &|m| m["levels"][0]["frame"]["gsd_m"] = 0.into(),
        &|m| m["model"]["descriptor_dim"] = 1_000_000.into(),
        &|m| m["model"]["global_dim"] = 0.into(),
        &|m| m["sections"][0]["offset"] = u64::MAX.into(),
        &|m| m["sections"][1]["name"] = "something else".into(),
        &|m| m["levels"] = serde_json::json!([]),
    ];
    for (i, change) in changes.iter().enumerate() {
        assert!(rewrite(change).is_err(), "change {i}");
    }
}

#[test]
fn another_model_is_refused() {
    let (_folder, path, _) = good();
    let pack = Pack::open(&path).unwrap();
    pack.check_model(&tiny_model(1)).unwrap();
    let error = pack.check_model(&tiny_model(2)).unwrap_err();
    assert!(matches!(error, PackError::ModelMismatch { .. }));
    assert!(error.to_string().contains("--model"), "{error}");
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
