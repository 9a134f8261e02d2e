//! Training starts from torchvision's weights: before the first step the encoder computes the same activations.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use burn::tensor::activation::relu;
use burn::tensor::module::{conv2d, max_pool2d};
use burn::tensor::ops::{ConvOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData};
use grimnet_net::{Domain, NetSpec};
use grimnet_train::data::{PairOptions, WorldOptions};
use grimnet_train::{Data, InputBuilder, Network, Statistics, TrainConfig, Trainer};
use image::{Rgb, RgbImage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rstest::rstest;
use safetensors::tensor::{Dtype, TensorView};
use std::collections::BTreeMap;
use std::path::Path;

const EPSILON: f32 = 1e-5;
const SIDE_PX: usize = 64;

/// A state dictionary: shape and values by name.
type State = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// Random weights with torchvision's names and shapes; `vgg16_bn` with `bn`.
fn torchvision(bn: bool) -> State {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut uniform = |len: usize, low: f32, high: f32| -> Vec<f32> {
        (0..len).map(|_| random.random_range(low..high)).collect()
    };
    let mut out = State::new();
    let (mut index, mut inputs) = (0, 3);
    for stage in NetSpec::vgg16().stages {
        for width in stage.widths {
            let bound = (6.0 / (9 * inputs) as f32).sqrt();
            let weight = uniform(width * inputs * 9, -bound, bound);
            let shape = vec![width, inputs, 3, 3];
            out.insert(format!("features.{index}.weight"), (shape, weight));
            let mut put = |name: String, values| {
                out.insert(name, (vec![width], values));
            };
            put(format!("features.{index}.bias"), uniform(width, -0.2, 0.2));
            if bn {
                let norm = format!("features.{}", index + 1);
                put(format!("{norm}.weight"), uniform(width, 0.5, 1.5));
                put(format!("{norm}.bias"), uniform(width, -0.3, 0.3));
                put(format!("{norm}.running_mean"), uniform(width, -0.3, 0.3));
                put(format!("{norm}.running_var"), uniform(width, 0.5, 1.5));
            }
            inputs = width;
            index += if bn { 3 } else { 2 };
        }
        index += 1;
    }
    out
}

/// The weights of `golden/torch/make_golden.py`, which PyTorch has written to `vgg16.pth` and `vgg16_bn.pth`.
fn torchvision_of_golden(bn: bool) -> State {
    let fraction = |k: usize| (k as u64 * 2_654_435_761 % (1 << 32)) as f64 / (1u64 << 32) as f64;
    let signed = |k: usize| (0.1 * (fraction(k) - 0.5)) as f32;
    let positive = |k: usize| (0.5 + fraction(k)) as f32;
    let weight = |[width, inputs]: [usize; 2]| {
        let taps = |start: usize| (0..9).map(move |tap| signed(start + tap));
        let kernels = |o: usize| (0..inputs).flat_map(move |i| taps(4 * o + 5 * i));
        (0..width).flat_map(kernels).collect()
    };
    let mut state = torchvision(bn);
    for (name, (shape, values)) in &mut state {
        let is_positive =
            name.ends_with("running_var") || (name.ends_with("weight") && shape.len() == 1);
        *values = match shape[..] {
            [width, inputs, ..] => weight([width, inputs]),
            _ if is_positive => (0..shape[0]).map(positive).collect(),
            _ => (0..shape[0]).map(signed).collect(),
        };
    }
    state
}

fn save(state: &State, path: &Path) {
    let bytes: Vec<Vec<u8>> = state
        .values()
        .map(|(_, values)| values.iter().flat_map(|v| v.to_le_bytes()).collect())
        .collect();
    let views = state.iter().zip(&bytes).map(|((name, (shape, _)), bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap();
        (name.clone(), view)
    });
    let file = safetensors::serialize(views, None).unwrap();
    std::fs::write(path, file).unwrap();
}

/// The features of torchvision's network (Simonyan and Zisserman 2015): convolution, bias, normalisation if there is one, ReLU,
/// and a maximum after each stage. `x` `[n, 3, h, w]`.
fn reference(state: &State, mut x: Tensor<4>, device: &Device) -> Tensor<4> {
    let flat = |name: &str| {
        let (_, values) = &state[name];
        let length = values.len();
        Tensor::<1>::from_data(TensorData::new(values.clone(), [length]), device)
    };
    let bn = state.keys().any(|name| name.ends_with("running_var"));
    let mut index = 0;
    for stage in NetSpec::vgg16().stages {
        for _ in stage.widths {
            let name = format!("features.{index}");
            let (shape, weight) = &state[&format!("{name}.weight")];
            let weight =
                Tensor::<4>::from_data(TensorData::new(weight.clone(), shape.clone()), device);
            let options = ConvOptions::new([1, 1], [1, 1], [1, 1], 1);
            x = conv2d(x, weight, Some(flat(&format!("{name}.bias"))), options);
            if bn {
                let norm = format!("features.{}", index + 1);
                let channel = |part: &str| flat(&format!("{norm}.{part}")).reshape([1, -1, 1, 1]);
                let deviation = (channel("running_var") + EPSILON).sqrt();
                x = (x - channel("running_mean")) / deviation * channel("weight") + channel("bias");
            }
            x = relu(x);
            index += if bn { 3 } else { 2 };
        }
        x = max_pool2d(x, MaxPoolOptions::new([2, 2]));
        index += 1;
    }
    x
}

#[rstest]
#[case::plain(false)]
#[case::with_normalisation(true)]
fn the_encoder_starts_as_torchvisions(
    #[case] bn: bool,
    #[values("safetensors", "pth")] format: &str,
) {
    let folder = tempfile::tempdir().unwrap();
    let (state, path) = if format == "pth" {
        let name = if bn { "vgg16_bn.pth" } else { "vgg16.pth" };
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/torch");
        (torchvision_of_golden(bn), golden.join(name))
    } else {
        let path = folder.path().join("vgg16.safetensors");
        let state = torchvision(bn);
        save(&state, &path);
        (state, path)
    };
    let config = TrainConfig {
        network: "vgg16".into(),
        out: folder.path().join("out"),
        start_from: Some(path),
        world_share: 1.0,
        world: WorldOptions {
            worlds: 1,
            places: 8,
        },
        pairs: PairOptions {
            side_px: SIDE_PX as u32,
            points: 12,
            ..PairOptions::default()
        },
        ..TrainConfig::default()
    };
    let device = Device::flex();
    let sources = Data::open(&config).unwrap().training;
    let trainer = Trainer::new(config, sources, &device, false).unwrap();
    let parameters = &trainer.state().parameters;

    let mut builder = InputBuilder::new(parameters.spec(), SIDE_PX, SIDE_PX);
    for (i, domain) in Domain::ALL.into_iter().enumerate() {
        let picture = RgbImage::from_fn(SIDE_PX as u32, SIDE_PX as u32, |x, y| {
            let block = (x / 9 + y / 7 + i as u32).is_multiple_of(3);
            let v = (x * 3 + y) as u8;
            Rgb([v, 255 - v, if block { 220 } else { 40 }])
        });
        builder.push(&picture, None, domain);
    }
    let input = builder.finish(&device);
    let expected = reference(
        &state,
        input.pictures.clone().permute([0, 3, 1, 2]),
        &device,
    );
    let expected = expected.permute([0, 2, 3, 1]);
    let found = Network::new(parameters, Statistics::Running)
        .forward(&input, false)
        .unwrap()
        .aggregated;
    let host = |x: Tensor<4>| x.try_into_vec_as::<f32>().unwrap();
    let (found, expected) = (host(found), host(expected));
    let scale = expected.iter().fold(0.0f32, |most, v| most.max(v.abs()));
    assert!(scale > 0.0);
    for (a, b) in found.iter().zip(&expected) {
        assert!(
            (a - b).abs() < 1e-3 * scale,
            "{a} where torchvision has {b}"
        );
    }
}
