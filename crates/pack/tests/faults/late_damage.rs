//! Damage that is found on first use.

use super::*;

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
fn each_level_notices_that_the_pack_was_changed() {
    let (_folder, path, bytes) = good_of(&BuildOptions {
        levels: Levels::Gsd(vec![0.25, 0.3]),
        ..one_level()
    });
    let pack = Pack::open_with(&path, &lazy()).unwrap();
    for level in pack.levels() {
        level.features(0).unwrap();
    }
    let mut other = bytes;
    for section in &pack.manifest().sections {
        if section.name.ends_with("/features") {
            other[section.offset as usize..][..1000].fill(7);
        }
    }
    let file = std::fs::File::options().write(true).open(&path).unwrap();
    std::io::Write::write_all(&mut &file, &other).unwrap();
    file.set_modified(std::time::SystemTime::now() + std::time::Duration::from_secs(5))
        .unwrap();
    // Whatever else looked at the file before.
    assert!(pack.verify(&mut |_| {}).is_err());
    for level in pack.levels() {
        let error = level.features(0).unwrap_err();
        assert!(matches!(error, PackError::Corrupt { .. }), "{error}");
    }
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
