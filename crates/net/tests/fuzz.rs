//! Model files with random descriptions, calibrations and weights, and right checksums: each is refused, or is a model that states
//! finite numbers.
//!
//! `PROPTEST_CASES` sets the number of inputs of each test (CONTRIBUTING.md, "Fuzzing").

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::sync::OnceLock;

use grimnet_net::Model;
use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::Value;

/// Inputs of each test in a normal run: each reads a file of megabytes.
const CASES: u32 = 24;

/// The bytes of the bundled model.
fn bundled() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/compact.safetensors");
        std::fs::read(path).unwrap()
    })
}

/// The file with another header and other tensor bytes, and the checksum of all of it.
fn rewritten(change: impl FnOnce(&mut Value), patches: &[(f64, Vec<u8>)]) -> Vec<u8> {
    let bytes = bundled();
    let (length, rest) = bytes.split_first_chunk::<8>().unwrap();
    let (header, tensors) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let mut header: Value = serde_json::from_slice(header).unwrap();
    change(&mut header);
    let zeros = "0".repeat(64);
    if let Some(checksum) = header.pointer_mut("/__metadata__/checksum") {
        *checksum = zeros.clone().into();
    }
    let mut text = serde_json::to_string(&header).unwrap();
    text += &" ".repeat(text.len().next_multiple_of(8) - text.len());
    let mut file = (text.len() as u64).to_le_bytes().to_vec();
    file.extend(text.as_bytes());
    let start = file.len();
    file.extend(tensors);
    for (share, patch) in patches {
        let at = start + (share * (tensors.len() - patch.len()) as f64) as usize;
        file[at..at + patch.len()].copy_from_slice(patch);
    }
    let checksum = blake3::hash(&file).to_hex();
    let prefix = b"\"checksum\":\"";
    if let Some(at) = file[..start]
        .windows(prefix.len())
        .position(|w| w == prefix)
    {
        let digits = &mut file[at + prefix.len()..][..64];
        if digits == zeros.as_bytes() {
            digits.copy_from_slice(checksum.as_bytes());
        }
    }
    file
}

/// Opens the file; whether it is a model.
fn check(bytes: &[u8]) -> bool {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new.safetensors");
    std::fs::write(&path, bytes).unwrap();
    match Model::open(&path) {
        Ok(model) => {
            let error = serde_json::to_value(model.calibration()).unwrap();
            let mut numbers = Vec::new();
            leaves(&error, "", &mut numbers);
            for path in numbers {
                // serde_json writes numbers that are not finite as null; these two may be absent.
                let number = error.pointer(&path).unwrap();
                assert!(
                    !number.is_null() || matches!(path.as_str(), "/confidence" | "/fitted_on"),
                    "{path}: {error}"
                );
            }
            true
        }
        Err(error) => {
            assert!(error.to_string().contains("new.safetensors"), "{error}");
            false
        }
    }
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

fn value() -> impl Strategy<Value = Value> {
    prop_oneof![
        (0..5u64).prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<f64>().prop_map(Value::from),
        Just(Value::Null),
        Just(Value::from("x")),
        Just(Value::Array(vec![])),
    ]
}

#[test]
fn a_file_that_is_only_rewritten_is_read() {
    assert!(check(&rewritten(|_| {}, &[])));
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn headers(changes in vec((any::<prop::sample::Index>(), value()), 1..3)) {
        let change = |header: &mut Value| {
            let mut paths = Vec::new();
            leaves(header, "", &mut paths);
            for (index, value) in &changes {
                if let Some(leaf) = header.pointer_mut(index.get::<String>(&paths)) {
                    *leaf = value.clone();
                }
            }
        };
        check(&rewritten(change, &[]));
    }

    /// Description and calibration are JSON within the header.
    #[test]
    fn descriptions(
        entry in prop_oneof![Just("spec"), Just("calibration"), Just("card")],
        changes in vec((any::<prop::sample::Index>(), value()), 1..3),
    ) {
        let change = |header: &mut Value| {
            let Some(text) = header.pointer_mut(&format!("/__metadata__/{entry}")) else {
                return;
            };
            let mut inner: Value = serde_json::from_str(text.as_str().unwrap()).unwrap();
            let mut paths = Vec::new();
            leaves(&inner, "", &mut paths);
            for (index, value) in &changes {
                if let Some(leaf) = inner.pointer_mut(index.get::<String>(&paths)) {
                    *leaf = value.clone();
                }
            }
            *text = inner.to_string().into();
        };
        check(&rewritten(change, &[]));
    }

    #[test]
    fn weights(patches in vec((0.0..1.0f64, vec(any::<u8>(), 1..64)), 1..4)) {
        check(&rewritten(|_| {}, &patches));
    }
}
