//! Round trips, damage and crafted contents of model files.

use super::*;

fn small() -> Model {
    Model::random(&crate::random::tiny_compact(), 3).unwrap()
}

#[test]
fn a_model_survives_a_round_trip_and_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (
        folder.path().join("a.safetensors"),
        folder.path().join("b.safetensors"),
    );
    let model = small();
    model.save(&a).unwrap();
    let read = Model::open(&a).unwrap();
    read.save(&b).unwrap();
    assert_eq!(read.hash(), model.hash());
    assert_eq!((read.spec(), read.card()), (model.spec(), model.card()));
    assert!(model.parameters().eq(read.parameters()));
    assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
    let bytes = std::fs::read(&a).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(
        file.tensor("encoder.0.0.weight").unwrap().dtype(),
        Dtype::F16
    );
    assert_eq!(file.tensor("netvlad.centres").unwrap().dtype(), Dtype::F32);
}

#[test]
fn int8_whitening_is_written_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    let model = small().with_whitening_precision(DataType::I8).unwrap();
    model.save(&path).unwrap();
    let read = Model::open(&path).unwrap();
    assert_eq!(read.hash(), model.hash());
    assert!(model.parameters().eq(read.parameters()));
    let bytes = std::fs::read(&path).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let dtype = |name: &str| file.tensor(name).unwrap().dtype();
    assert_eq!(dtype("whitening.projection"), Dtype::I8);
    assert_eq!(dtype("whitening.projection.scale"), Dtype::F32);
}

fn calibration() -> Calibration {
    Calibration {
        position: crate::PositionError {
            inlier_factor: 2.5,
            shared_px: 1.25,
        },
        fitted_on: Some(crate::FittedOn {
            data: "ten towns".into(),
            ..crate::FittedOn::default()
        }),
        ..Calibration::default()
    }
}

#[test]
fn a_calibration_is_kept_and_does_not_change_the_identity() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    small()
        .with_calibration(calibration())
        .unwrap()
        .save(&path)
        .unwrap();
    let read = Model::open(&path).unwrap();
    assert_eq!(*read.calibration(), calibration());
    assert_eq!(read.hash(), small().hash());
    small().save(&path).unwrap();
    let plain = Model::open(&path).unwrap();
    assert_eq!(*plain.calibration(), Calibration::default());
}

/// The bytes with `from` replaced by `to`, of the same length, and the checksum computed again.
fn patched(good: &[u8], from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let at = good
        .windows(from.len())
        .position(|w| w == from.as_bytes())
        .unwrap();
    let mut bytes = good.to_vec();
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    with_checksum(bytes)
}

fn with_checksum(mut bytes: Vec<u8>) -> Vec<u8> {
    let at = checksum_position(&bytes).unwrap();
    bytes[at..][..CHECKSUM_LEN].fill(b'0');
    let checksum = blake3::hash(&bytes).to_hex();
    bytes[at..][..CHECKSUM_LEN].copy_from_slice(checksum.as_bytes());
    bytes
}

fn refusal(bytes: &[u8]) -> ModelFileError {
    match Model::from_bytes(bytes, Path::new("model.safetensors")) {
        Err(error @ NetError::ModelFile { .. }) => {
            assert!(
                error.to_string().starts_with("model.safetensors: "),
                "{error}"
            );
            let NetError::ModelFile { reason, .. } = error else {
                unreachable!()
            };
            reason
        }
        other => panic!("{other:?}"),
    }
}

fn bytes_of(model: &Model) -> Vec<u8> {
    let mut bytes = Vec::new();
    model.write(&mut bytes).unwrap();
    bytes
}

#[test]
fn one_flipped_bit_anywhere_is_refused() {
    let model = small()
        .with_whitening_precision(DataType::I8)
        .unwrap()
        .with_calibration(calibration())
        .unwrap();
    let good = bytes_of(&model);
    Model::from_bytes(&good, Path::new("good")).unwrap();
    let header = LENGTH_BYTES + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    // Every byte of the header, and a sample of the weights.
    let flips = (0..header).chain((header..good.len()).step_by(61));
    for (i, at) in flips.enumerate() {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (i % 8);
        let reason = refusal(&bytes);
        if at >= header {
            assert!(
                matches!(reason, ModelFileError::Checksum { .. }),
                "{at}: {reason}"
            );
        }
    }
}

#[test]
fn crafted_calibrations_are_refused() {
    let good = bytes_of(&small().with_calibration(calibration()).unwrap());
    assert_eq!(with_checksum(good.clone()), good);
    for (from, to) in [
        ("inlier_factor\\\":2.5", "inlier_factor\\\":0.0"),
        ("inlier_factor\\\":2.5", "inlier_factor\\\":-25"),
        ("shared_px\\\":1.25", "shared_px\\\":-1.2"),
        ("shared_px\\\":1.25", "shared_px\\\":0e-9"),
        ("shared_px\\\":1.25", "shared_px\\\":9e99"),
    ] {
        let reason = refusal(&patched(&good, from, to));
        assert!(
            matches!(reason, ModelFileError::Calibration(_)),
            "{to}: {reason}"
        );
    }
    for (from, to) in [
        ("shared_px\\\":1.25", "shared_px\\\":null"),
        ("shared_px\\\":1.25", "shared_px\\\":9e999"),
        ("shared_px\\\":1.25", "shared_px\\\": NaN"),
    ] {
        let from = &format!("{from}}}").to_owned()[..];
        let to = &format!("{to}}}")[..from.len()];
        let reason = refusal(&patched(&good, from, to));
        assert!(
            matches!(
                reason,
                ModelFileError::Metadata {
                    entry: "calibration",
                    ..
                }
            ),
            "{to}: {reason}"
        );
    }
    assert!(matches!(
        small().with_calibration(Calibration {
            position: crate::PositionError {
                inlier_factor: f64::NAN,
                shared_px: 1.0
            },
            ..Calibration::default()
        }),
        Err(NetError::Calibration(_))
    ));
}

#[test]
fn unusable_files_are_refused_with_their_name() {
    let good = bytes_of(&small());
    assert!(matches!(refusal(b""), ModelFileError::NotSafetensors(_)));
    refusal(&good[..good.len() / 2]);
    refusal(&good[..good.len() - 1]);
    refusal(&[&good[..], b"more"].concat());
    let patch = |from, to| refusal(&patched(&good, from, to));
    assert!(matches!(
        patch(
            "grimnet_model_version\":\"2\"",
            "grimnet_model_version\":\"9\""
        ),
        ModelFileError::Version { .. }
    ));
    assert!(matches!(
        patch("grimnet_model_version", "grimnet_model_wersion"),
        ModelFileError::MissingMetadata(VERSION_KEY)
    ));
    assert!(matches!(
        patch("encoder.0.0.weight", "encoder.9.0.weight"),
        ModelFileError::Parameters(ParameterError::Missing(_))
    ));
    let at = checksum_position(&good).unwrap() - CHECKSUM_PREFIX.len();
    let mut without = good.clone();
    without[at + 1] = b'x';
    assert!(matches!(
        refusal(&without),
        ModelFileError::MissingMetadata(CHECKSUM_KEY)
    ));
    let mut not_finite = good.clone();
    let last = not_finite.len() - 2;
    not_finite[last..].copy_from_slice(&[0xff, 0x7f]);
    assert!(matches!(
        refusal(&with_checksum(not_finite)),
        ModelFileError::Parameters(ParameterError::NotFinite(_))
    ));
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(
        Model::open(folder.path().join("absent")),
        Err(NetError::Io { .. })
    ));
}

#[test]
fn a_file_beyond_the_limit_is_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.safetensors");
    // All of it is a hole: it takes no disk.
    let file = std::fs::File::create(&path).unwrap();
    file.set_len(1 << 40).unwrap();
    let error = Model::open(&path).unwrap_err();
    assert!(matches!(
        error,
        NetError::ModelFile {
            reason: ModelFileError::TooLarge { .. },
            ..
        }
    ));
    assert!(error.to_string().contains("large.safetensors"), "{error}");
}

#[test]
fn int8_whitening_without_rows_is_refused() {
    let good = bytes_of(&small().with_whitening_precision(DataType::I8).unwrap());
    let (header_len, _) = SafeTensors::read_metadata(&good).unwrap();
    let (header, tensors) = good[LENGTH_BYTES..].split_at(header_len);
    let mut header: Value = serde_json::from_slice(header).unwrap();
    // Both tensors of the projection, which are the last ones, become single values.
    let mut end = header["whitening.projection"]["data_offsets"][0]
        .as_u64()
        .unwrap();
    for (name, len) in [
        ("whitening.projection", 1),
        ("whitening.projection.scale", 4),
    ] {
        header[name]["shape"] = json!([]);
        header[name]["data_offsets"] = json!([end, end + len]);
        end += len;
    }
    let header = serde_json::to_vec(&header).unwrap();
    let parts = [
        &(header.len() as u64).to_le_bytes(),
        header.as_slice(),
        &tensors[..end as usize],
    ];
    let reason = refusal(&with_checksum(parts.concat()));
    assert!(
        matches!(
            reason,
            ModelFileError::Parameters(ParameterError::Shape { .. })
        ),
        "{reason}"
    );
}

#[test]
fn files_of_version_1_have_no_checksum_and_are_read() {
    let good = bytes_of(&small());
    let at = checksum_position(&good).unwrap() - CHECKSUM_PREFIX.len();
    let mut old = good.clone();
    old[at + 1] = b'x';
    let version = b"grimnet_model_version\":\"2";
    let at = good
        .windows(version.len())
        .position(|w| w == version)
        .unwrap();
    old[at + version.len() - 1] = b'1';
    let read = Model::from_bytes(&old, Path::new("old")).unwrap();
    assert_eq!(read.hash(), small().hash());
}
