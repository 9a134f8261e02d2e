//! Files that are damaged, forged or of another version.

use super::*;

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
    // Lists that do not end where the keypoints do.
    let (_folder, path, bytes) = good_of(&indexed());
    for name in ["list_starts", "centroids"] {
        let file = forged(&bytes, &|_| {}, &|m, file| {
            let at = section_of(m, &format!("0/keypoints.{name}"));
            file[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        });
        assert!(open(&path, &file).is_err(), "{name}");
    }
    let fewer = |m: &mut serde_json::Value| m["levels"][0]["keypoint_index"]["lists"] = 1.into();
    assert!(open(&path, &forged(&bytes, &fewer, &|_, _| {})).is_err());
    // A scale that is not a number, in the table of scales.
    let (_folder, path, bytes) = good();
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
