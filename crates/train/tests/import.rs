//! PyTorch's files (written by `golden/torch/make_golden.py`) and torchvision's VGG-16.

#![allow(clippy::unwrap_used)]

use grimnet_net::{BATCH_NORM_EPSILON, NetSpec};
use grimnet_train::import::{NamedTensor, encoder_from_torchvision, read_tensors};
use std::collections::BTreeMap;
use std::path::PathBuf;

fn golden(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden/torch")
        .join(name)
}

#[test]
fn every_format_holds_the_same_tensors() {
    for name in [
        "archive.pth",
        "stream.pth",
        "nested.pth",
        "tensors.safetensors",
    ] {
        let tensors = read_tensors(&golden(name)).unwrap();
        assert_eq!(tensors.len(), 3, "{name}");
        let weight = &tensors["features.0.weight"];
        assert_eq!(weight.shape, [2, 3, 3, 3]);
        assert!(
            weight
                .values
                .iter()
                .enumerate()
                .all(|(i, v)| (v - i as f32 * 0.01).abs() < 1e-6)
        );
        assert_eq!(tensors["features.0.bias"].values, [0.25, -0.5]);
        let strided = &tensors["strided"];
        assert_eq!(strided.shape, [3, 4], "{name}");
        for row in 0..3 {
            for column in 0..4 {
                let wanted = (column * 6 + row + 1) as f32 * 0.5 - 3.0;
                assert_eq!(strided.values[row * 4 + column], wanted, "{name}");
            }
        }
    }
}

#[test]
fn a_file_cut_short_or_of_another_kind_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.pth");
    for name in ["archive.pth", "stream.pth", "tensors.safetensors"] {
        let bytes = std::fs::read(golden(name)).unwrap();
        for end in (0..bytes.len()).step_by(37) {
            std::fs::write(&path, &bytes[..end]).unwrap();
            assert!(read_tensors(&path).is_err(), "{name} cut at {end}");
        }
    }
    std::fs::write(&path, b"<html>not found</html>").unwrap();
    let error = read_tensors(&path).unwrap_err().to_string();
    assert!(error.contains("cut.pth"), "{error}");
}

/// A state dictionary with torchvision's names: convolutions at these indices, each followed by its normalisation where `bn`.
fn torchvision(bn: bool) -> BTreeMap<String, NamedTensor> {
    let spec = NetSpec::vgg16();
    let mut out = BTreeMap::new();
    let (mut index, mut channels) = (0, 3);
    for stage in &spec.stages {
        for &width in &stage.widths {
            let mut put = |name: String, shape: &[usize], value: f32| {
                let shape = shape.to_vec();
                let values = vec![value; shape.iter().product()];
                out.insert(name, NamedTensor { shape, values });
            };
            put(
                format!("features.{index}.weight"),
                &[width, channels, 3, 3],
                index as f32,
            );
            put(format!("features.{index}.bias"), &[width], 0.5);
            if bn {
                for (part, value) in [
                    ("weight", 2.0),
                    ("bias", 3.0),
                    ("running_mean", 4.0),
                    ("running_var", 5.0),
                ] {
                    put(format!("features.{}.{part}", index + 1), &[width], value);
                }
            }
            channels = width;
            index += if bn { 3 } else { 2 };
        }
        index += 1;
    }
    out.insert(
        "classifier.0.weight".into(),
        NamedTensor {
            shape: vec![2, 2],
            values: vec![0.0; 4],
        },
    );
    out
}

#[test]
fn torchvision_layers_land_in_their_places() {
    let spec = NetSpec::vgg16();
    let shapes: BTreeMap<String, Vec<usize>> = spec.parameters().into_iter().collect();
    for (bn, last) in [(true, 40.0), (false, 28.0)] {
        let encoder = encoder_from_torchvision(&torchvision(bn)).unwrap();
        assert_eq!(encoder.has_norms, bn);
        let encoder = encoder.tensors;
        for (name, values) in &encoder {
            assert_eq!(
                values.len(),
                shapes[name].iter().product::<usize>(),
                "{name}"
            );
        }
        let names = shapes
            .keys()
            .filter(|name| name.starts_with("encoder."))
            .count();
        assert_eq!(encoder.len(), names);
        let of = |name: &str| encoder.iter().find(|(n, _)| n == name).unwrap().1[0];
        assert_eq!(of("encoder.0.0.weight"), 0.0);
        assert_eq!(of("encoder.4.2.weight"), last);
        let wanted = if bn {
            [2.0, 3.0, 3.5, 5.0]
        } else {
            [1.0, 0.5, 0.0, 1.0 - BATCH_NORM_EPSILON]
        };
        for (part, wanted) in ["weight", "bias", "mean", "var"].into_iter().zip(wanted) {
            assert_eq!(
                of(&format!("encoder.2.1.norm.uav.{part}")),
                wanted,
                "{part}"
            );
        }
    }
    let mut wrong = torchvision(true);
    wrong.remove("features.40.weight");
    assert!(
        encoder_from_torchvision(&wrong)
            .unwrap_err()
            .contains("12 convolutions")
    );
}
