//! The trainer's network against the engine that runs it: one forward pass, the same numbers.

#![allow(clippy::unwrap_used)]

use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};
use grimnet_net::{Card, Domain, Extractor, Model, NetSpec, VladInput};
use grimnet_train::{InputBuilder, Network, Parameters, Statistics};
use image::{Rgb, RgbImage};
use rstest::rstest;

const SIZE_PX: (u32, u32) = (96, 64);
/// Factor on the assignment's random weights for vectors that are not scaled to unit length.
const UNSCALED_WEIGHT: f32 = 0.01;

fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as::<f32>().unwrap()
}

/// Something with edges and slopes.
fn picture(seed: u32) -> RgbImage {
    RgbImage::from_fn(SIZE_PX.0, SIZE_PX.1, |x, y| {
        let wave = |c: u32| ((x * (3 + c) + y * (7 - c) + seed * 31) as f32 * 0.21).sin() * 60.0;
        let block = if (x / 9 + y / 7 + seed).is_multiple_of(3) {
            70.0
        } else {
            0.0
        };
        Rgb(std::array::from_fn(|c| {
            (110.0 + wave(c as u32) + block).clamp(0.0, 255.0) as u8
        }))
    })
}

/// Numbers of a network with normalisations that differ between the domains and from the identity.
fn shaken(model: &Model, device: &Device) -> Parameters {
    let mut parameters = Parameters::of_model(model, device);
    for (i, name) in parameters.names().into_iter().enumerate() {
        if !name.contains(".norm.") {
            continue;
        }
        let old = host(parameters.flat(&name).unwrap());
        let change = |(j, v): (usize, f32)| {
            let wave = ((i * 7 + j * 3) as f32).sin();
            if name.ends_with(".var") || name.ends_with(".weight") {
                v * (1.0 + 0.2 * wave)
            } else {
                v + 0.1 * wave
            }
        };
        let values: Vec<f32> = old.into_iter().enumerate().map(change).collect();
        let length = values.len();
        let value = Tensor::from_data(burn::tensor::TensorData::new(values, [length]), device);
        parameters.set(&name, value).unwrap();
    }
    if model.spec().vlad.input == VladInput::DeepestUnscaled {
        // Vectors of any length times random weights leave most clusters with an assignment near the smallest float, and
        // what intra-normalisation makes of that is rounding. Training starts from clusters that fit the vectors.
        let name = "netvlad.assign.weight";
        let soft: Vec<f32> = host(parameters.flat(name).unwrap())
            .into_iter()
            .map(|v| v * UNSCALED_WEIGHT)
            .collect();
        let length = soft.len();
        let value = Tensor::from_data(burn::tensor::TensorData::new(soft, [length]), device);
        parameters.set(name, value).unwrap();
    }
    parameters
}

fn close(ours: &[f32], theirs: &[f32], what: &str) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let scale = theirs.iter().fold(0.0f32, |most, v| most.max(v.abs()));
    assert!(scale > 0.0, "{what} is empty");
    for (a, b) in ours.iter().zip(theirs) {
        assert!(
            (a - b).abs() < 1e-4 * scale,
            "{what}: {a} where the engine has {b}"
        );
    }
}

/// `[cells, 65]` probabilities of one picture to height x width (paper, eq. 12).
fn heatmap(probabilities: &[f32]) -> Vec<f32> {
    let (width, columns) = (SIZE_PX.0 as usize, SIZE_PX.0 as usize / 8);
    let mut out = vec![0.0; width * SIZE_PX.1 as usize];
    for (cell, row) in probabilities.chunks_exact(65).enumerate() {
        for (place, probability) in row.iter().enumerate().take(64) {
            let (y, x) = (
                cell / columns * 8 + place / 8,
                cell % columns * 8 + place % 8,
            );
            out[y * width + x] = *probability;
        }
    }
    out
}

#[rstest]
#[case::compact(NetSpec::compact())]
#[case::vgg16(NetSpec::vgg16())]
#[case::vgg16_lateral(NetSpec::vgg16_lateral())]
#[case::vgg16_paper(NetSpec::vgg16_paper())]
fn both_domains_are_the_engines(#[case] spec: NetSpec) {
    let device = Device::flex();
    let start = Model::random(&spec, 3).unwrap();
    // Through the model file's precision, so that both sides hold the same numbers.
    let model = shaken(&start, &device).to_model(Card::default()).unwrap();
    let parameters = Parameters::of_model(&model, &device);
    let pictures = [(Domain::Sat, picture(1)), (Domain::Uav, picture(2))];
    let mut builder = InputBuilder::new(&spec, SIZE_PX.0 as usize, SIZE_PX.1 as usize);
    for (domain, picture) in &pictures {
        builder.push(picture, None, *domain);
    }
    let input = builder.finish(&device);
    let output = Network::new(&parameters, Statistics::Running)
        .forward(&input, true)
        .unwrap();
    let probabilities = host(softmax(output.keypoints, 1));
    let (descriptors, global) = (host(output.descriptors), host(output.global));

    for (i, (domain, picture)) in pictures.iter().enumerate() {
        let dense = Extractor::new(&model, *domain)
            .unwrap()
            .dense(picture, None)
            .unwrap();
        fn of(all: &[f32], i: usize) -> &[f32] {
            let half = all.len() / 2;
            &all[i * half..(i + 1) * half]
        }
        close(&heatmap(of(&probabilities, i)), dense.heatmap(), "heatmap");
        close(
            of(&descriptors, i),
            &dense.descriptors().to_hwc(),
            "descriptors",
        );
        let whole = dense.vlad([0, 0, SIZE_PX.0, SIZE_PX.1], None);
        close(
            of(&global, i),
            &model.global_descriptor(&whole),
            "global descriptor",
        );
    }
}
