//! The network against PyTorch (`golden/make_golden.py`): the same weights, the same picture.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use grimnet_kernels::Isa;
use grimnet_net::{Card, Dense, Domain, ExtractOptions, Extractor, Model, NetSpec, Statistics};
use image::{GrayImage, RgbImage};
use safetensors::SafeTensors;

/// Largest difference, as a share of the largest value.
const TOLERANCE: f32 = 1e-4;
const OPTIONS: ExtractOptions = ExtractOptions {
    threshold: 0.03,
    max_keypoints: 60,
    nms_radius_px: 2,
};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// What PyTorch wrote.
struct Golden {
    bytes: Vec<u8>,
    image: RgbImage,
    mask: GrayImage,
}

impl Golden {
    fn open(name: &str) -> Self {
        let bytes = std::fs::read(folder().join(format!("{name}.safetensors"))).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let (image, mask) = (file.tensor("image").unwrap(), file.tensor("mask").unwrap());
        let (height, width) = (mask.shape()[0] as u32, mask.shape()[1] as u32);
        let image = RgbImage::from_raw(width, height, image.data().to_vec()).unwrap();
        let mask = GrayImage::from_raw(width, height, mask.data().to_vec()).unwrap();
        Self { bytes, image, mask }
    }

    fn has(&self, name: &str) -> bool {
        SafeTensors::deserialize(&self.bytes)
            .unwrap()
            .tensor(name)
            .is_ok()
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let (numbers, _) = file.tensor(name).unwrap().data().as_chunks::<4>();
        numbers.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    fn check(&self, name: &str, values: &[f32]) {
        let expected = self.floats(name);
        assert_eq!(values.len(), expected.len(), "{name}");
        let largest = expected.iter().fold(0.0, |m: f32, v| m.max(v.abs()));
        let differences = values.iter().zip(&expected).map(|(a, b)| (a - b).abs());
        let worst = differences.fold(
            0.0,
            |m: f32, v| if v.is_nan() { f32::INFINITY } else { m.max(v) },
        ) / largest;
        println!("{name}: {worst:.1e}");
        assert!(worst < TOLERANCE, "{name}: relative error {worst:e}");
    }
}

/// The numbers of `golden/network.py`: FNV-1a of the name, then splitmix64, as odd multiples of 1/2048.
fn numbers(name: &str, count: usize) -> impl Iterator<Item = f32> {
    let fnv = |seed: u64, byte: u8| (seed ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    let seed = name.bytes().fold(0xcbf2_9ce4_8422_2325, fnv);
    (1..=count as u64).map(move |i| {
        let z = seed.wrapping_add(i.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let z = z ^ (z >> 31);
        (2.0 * (z >> 53) as f32 - 2047.0) / 2048.0
    })
}

/// The network of `fill` in `golden/network.py`.
fn filled(spec: &NetSpec) -> Model {
    let values = spec.parameters().into_iter().map(|(name, shape)| {
        let fan_in = match shape[..] {
            [input, _, _, _] if name.starts_with("upsample") => input * 4,
            [_, input, rows, columns] => input * rows * columns,
            _ => 0,
        };
        let (offset, factor) = match name.as_str() {
            "netvlad.assign.weight" => (0.0, 4.0),
            "whitening.projection" => (0.0, 1.0 / 32.0),
            "whitening.mean" => (0.0, 1.0 / 128.0),
            "netvlad.centres" => (0.0, 1.0),
            _ if fan_in > 0 => {
                let extra = match name.as_str() {
                    "keypoint.weight" => -2.0,
                    "keypoint.out.weight" => 2.0,
                    _ => 0.0,
                };
                (
                    0.0,
                    (((6.0 / fan_in as f64).sqrt().log2() + extra).round_ties_even() as f32).exp2(),
                )
            }
            _ if name.contains(".norm.")
                && (name.ends_with(".weight") || name.ends_with(".var")) =>
            {
                (1.0, 0.5)
            }
            _ => (0.0, 0.25),
        };
        let values = numbers(&name, shape.iter().product())
            .map(|v| offset + factor * v)
            .collect();
        (name, values)
    });
    Model::from_values(
        spec.clone(),
        Card {
            random: true,
            ..Card::default()
        },
        values,
    )
    .unwrap()
}

fn compare(model: &Model, name: &str, domain: Domain) {
    let golden = Golden::open(name);
    let (width, height) = golden.image.dimensions();
    let global =
        |dense: &Dense, mask| model.global_descriptor(&dense.vlad([0, 0, width, height], mask));
    for isa in Isa::available() {
        println!("{name} on {isa:?}");
        let stored = Statistics::of_model(model, domain).unwrap();
        let extractor = Extractor::with_isa(model, domain, &stored, isa).unwrap();
        let dense = extractor.dense(&golden.image, None).unwrap();
        golden.check("heatmap", dense.heatmap());
        golden.check("descriptors", &dense.descriptors().to_hwc());
        golden.check("global", &global(&dense, None));

        let keypoints = dense.keypoints([0, 0, width, height], &OPTIONS, Some(&golden.mask));
        let expected = golden.floats("keypoints");
        assert_eq!(keypoints.len(), expected.len() / 3);
        for (keypoint, expected) in keypoints.iter().zip(expected.chunks_exact(3)) {
            assert_eq!([keypoint.x_px, keypoint.y_px], expected[..2]);
        }
        golden.check(
            "keypoints",
            &keypoints
                .iter()
                .flat_map(|k| [k.x_px, k.y_px, k.score])
                .collect::<Vec<_>>(),
        );
        golden.check("keypoint_descriptors", &dense.describe(&keypoints));

        if golden.has("instance.heatmap") {
            let (own, statistics) = extractor
                .dense_instance(&golden.image, Some(&golden.mask))
                .unwrap();
            golden.check("instance.heatmap", own.heatmap());
            golden.check("instance.descriptors", &own.descriptors().to_hwc());
            golden.check("instance.global", &global(&own, Some(&golden.mask)));
            let layers = statistics.layers();
            golden.check(
                "instance.mean",
                &layers
                    .iter()
                    .flat_map(|l| l.mean.clone())
                    .collect::<Vec<_>>(),
            );
            golden.check(
                "instance.var",
                &layers
                    .iter()
                    .flat_map(|l| l.var.clone())
                    .collect::<Vec<_>>(),
            );

            // Statistics of the picture, folded into the weights, say the same as taking them on the way.
            let adapted = Extractor::with_isa(model, domain, &statistics, isa).unwrap();
            golden.check(
                "instance.heatmap",
                adapted
                    .dense(&golden.image, Some(&golden.mask))
                    .unwrap()
                    .heatmap(),
            );
        }
    }
}

/// A model file that Python wrote; its numbers are those of the formula.
fn opened(name: &str) -> Model {
    let model = Model::open(folder().join(format!("{name}.model.safetensors"))).unwrap();
    assert_eq!(model.hash(), filled(model.spec()).hash());
    model
}

#[test]
fn tiny_compact_equals_pytorch() {
    compare(&opened("tiny_compact"), "tiny_compact", Domain::Uav);
}

#[test]
fn tiny_vgg16_equals_pytorch() {
    compare(&opened("tiny_vgg16"), "tiny_vgg16", Domain::Sat);
}

/// As published: no normalisation after the transposed convolutions (eq. 4), NetVLAD's input not scaled (eq. 5-6).
#[test]
fn tiny_vgg16_paper_equals_pytorch() {
    compare(&opened("tiny_vgg16_paper"), "tiny_vgg16_paper", Domain::Sat);
}

#[test]
fn compact_equals_pytorch() {
    compare(&filled(&NetSpec::compact()), "compact", Domain::Sat);
}

#[test]
fn vgg16_equals_pytorch() {
    compare(&filled(&NetSpec::vgg16()), "vgg16", Domain::Uav);
}
