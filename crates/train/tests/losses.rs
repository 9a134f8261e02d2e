//! Every loss, its gradient, the normalisation and the optimiser against PyTorch (`golden/make_golden.py`).

#![allow(clippy::unwrap_used)]

use burn::tensor::{Device, Tensor, TensorData};
use grimnet_net::{Model, NetSpec};
use grimnet_train::data::Scene;
use grimnet_train::loss::{
    Correspondences, HingeOptions, HomographyOptions, MultiSimilarityOptions, TripletOptions,
    descriptor_contrast, descriptor_distillation, descriptor_hinge, global_contrast,
    homography_reprojection, keypoint_cross_entropy, keypoint_distillation, multi_similarity,
    scene_cross_entropy, similarity_distillation, triplet,
};
use grimnet_train::ops::{Group, follow_moments, norm_relu};
use grimnet_train::{Adam, AdamOptions, Parameters, StepOptions};
use rstest::rstest;
use serde_json::Value;
use std::sync::Arc;

fn golden() -> Value {
    serde_json::from_str(include_str!("golden/losses.json")).unwrap()
}

fn numbers(value: &Value) -> Vec<f32> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap() as f32],
    }
}

fn numbers_or_none(value: &Value) -> Option<Vec<f32>> {
    (!value.is_null()).then(|| numbers(value))
}

fn flags(value: &Value) -> Vec<bool> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v.as_bool().unwrap())
        .collect()
}

fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as::<f32>().unwrap()
}

fn close(ours: &[f32], theirs: &[f32], what: &str) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let scale = theirs.iter().fold(1e-3f32, |most, v| most.max(v.abs()));
    for (a, b) in ours.iter().zip(theirs) {
        assert!(
            (a - b).abs() < 2e-4 * scale,
            "{what}: {a} where PyTorch has {b}"
        );
    }
}

/// Computes a case by `loss`, which gets the inputs in the order of `names`, and compares value and gradients.
fn check<const D: usize>(
    name: &str,
    names: &[&str],
    loss: impl Fn(&[Tensor<D>], &Value, &Device) -> Tensor<1>,
) {
    let device = Device::flex().autodiff();
    let all = golden();
    let case = &all[name];
    let inputs: Vec<Tensor<D>> = names
        .iter()
        .map(|input| {
            let shape: Vec<usize> = numbers(&case["inputs"][input]["shape"])
                .iter()
                .map(|v| *v as usize)
                .collect();
            let values = numbers(&case["inputs"][input]["values"]);
            tensor::<D>(values, shape.try_into().unwrap(), &device).require_grad()
        })
        .collect();
    let value = loss(&inputs, case, &device);
    close(
        &host(value.clone()),
        &[case["value"].as_f64().unwrap() as f32],
        name,
    );
    let gradients = value.backward();
    for (input, name_of) in inputs.iter().zip(names) {
        let ours = host(input.grad(&gradients).unwrap());
        close(
            &ours,
            &numbers(&case["gradients"][name_of]),
            &format!("{name}, gradient of {name_of}"),
        );
    }
}

/// Rows to unit length, as the network's are.
fn unit(rows: &Tensor<2>) -> Tensor<2> {
    rows.clone() / rows.clone().square().sum_dim(1).sqrt()
}

#[test]
fn keypoint_cross_entropy_is_pytorchs() {
    check::<2>("keypoint", &["logits"], |x, case, _| {
        let labels: Vec<u8> = numbers(&case["labels"]).iter().map(|v| *v as u8).collect();
        keypoint_cross_entropy(x[0].clone(), &labels, &numbers(&case["weights"]))
    });
}

#[test]
fn triplet_takes_the_hardest_negatives_that_are_allowed() {
    check::<2>("triplet", &["sat", "uav"], |x, case, _| {
        let options = TripletOptions {
            margin: 0.5,
            hardest: 2,
        };
        triplet(
            unit(&x[0]),
            unit(&x[1]),
            &flags(&case["excluded"]),
            &options,
        )
    });
}

#[test]
fn multi_similarity_is_its_equation() {
    check::<2>("multi_similarity", &["sat", "uav"], |x, case, _| {
        let options = MultiSimilarityOptions::default();
        multi_similarity(
            unit(&x[0]),
            unit(&x[1]),
            &flags(&case["excluded"]),
            &options,
        )
    });
}

#[test]
fn global_contrast_is_cross_entropy_against_batch_and_memory() {
    check::<2>("global_contrast", &["sat", "uav"], |x, case, device| {
        let memory = tensor(numbers(&case["memory"]), [5, 8], device);
        global_contrast(
            x[0].clone(),
            x[1].clone(),
            Some(memory),
            &flags(&case["excluded"]),
            1.0 / 16.0,
        )
    });
}

#[test]
fn descriptor_contrast_is_cross_entropy_both_ways() {
    check::<2>("descriptor_contrast", &["a", "b"], |x, _, _| {
        descriptor_contrast(x[0].clone(), x[1].clone(), 2, 0.1)
    });
}

#[test]
fn descriptor_hinge_is_its_equation() {
    check::<2>("descriptor_hinge", &["a", "b"], |x, case, _| {
        let options = HingeOptions::default();
        descriptor_hinge(
            x[0].clone(),
            x[1].clone(),
            2,
            &flags(&case["same"]),
            &options,
        )
    });
}

#[test]
fn homography_reprojection_is_a_dense_solvers() {
    check::<2>("homography", &["a", "b"], |x, case, device| {
        let places = |name: &str| tensor(numbers(&case[name]), [2, 7, 2], device);
        let points = Correspondences {
            from_px: places("from_px"),
            to_px: places("to_px"),
            side_px: 128.0,
        };
        let options = HomographyOptions {
            temperature: 0.3,
            unit_px: 8.0,
        };
        homography_reprojection(x[0].clone(), x[1].clone(), &points, &options)
    });
}

#[test]
fn scenes_compete_within_their_data_set() {
    check::<2>("scenes", &["logits"], |x, case, _| {
        let scene = |value: &Value| match numbers_or_none(value)?[..] {
            [class, first, end] => Some(Scene {
                class: class as usize,
                among: first as usize..end as usize,
            }),
            _ => None,
        };
        let scenes: Vec<Option<Scene>> = case["scenes"]
            .as_array()
            .unwrap()
            .iter()
            .map(scene)
            .collect();
        let scenes: Vec<Option<&Scene>> = scenes.iter().map(Option::as_ref).collect();
        scene_cross_entropy(x[0].clone(), &scenes)
    });
}

#[rstest]
#[case::keypoints("keypoint_distillation", "logits", [12, 65])]
#[case::descriptors("descriptor_distillation", "student", [12, 5])]
#[case::similarities("similarity_distillation", "student", [6, 5])]
fn distillation_is_pytorchs(#[case] name: &str, #[case] input: &str, #[case] shape: [usize; 2]) {
    check::<2>(name, &[input], |x, case, device| {
        let teacher = tensor(numbers(&case["teacher"]), shape, device);
        let student = x[0].clone();
        match name {
            "keypoint_distillation" => {
                keypoint_distillation(student, teacher, &numbers(&case["weights"]))
            }
            "descriptor_distillation" => {
                descriptor_distillation(student, teacher, &numbers(&case["weights"]))
            }
            _ => similarity_distillation(student, teacher),
        }
    });
}

#[test]
fn normalisation_and_its_running_statistics_are_pytorchs() {
    let rows = [9, 14];
    let groups = Arc::new(vec![
        Group {
            rows: rows[0],
            domain: 0,
        },
        Group {
            rows: rows[1],
            domain: 1,
        },
    ]);
    check::<2>(
        "normalisation",
        &["x", "gamma", "beta"],
        |x, case, device| {
            let (y, mean, variance) =
                norm_relu(x[0].clone(), x[1].clone(), x[2].clone(), &groups, 1e-5);
            let plain = device.clone().without_autodiff();
            for domain in 0..2 {
                let old = [0, 1].map(|i| tensor(numbers(&case["old"][domain][i]), [5], &plain));
                let row = |found: &Tensor<2>| found.clone().narrow(0, domain, 1).reshape([5]);
                let followed = follow_moments(old, [row(&mean), row(&variance)], rows[domain]);
                for (i, value) in followed.into_iter().enumerate() {
                    close(
                        &host(value),
                        &numbers(&case["running"][domain][i]),
                        "running statistics",
                    );
                }
            }
            (y * tensor(numbers(&case["pull"]), [23, 5], device)).sum()
        },
    );
}

/// With small gradients the step depends on where epsilon is added.
#[rstest]
#[case::clipped_by_the_global_norm("adam", 2.0, AdamOptions::default())]
#[case::gradients_near_epsilon("adam_small_gradients", f32::INFINITY, AdamOptions::pytorch())]
fn adam_steps_as_pytorchs(#[case] name: &str, #[case] clip: f32, #[case] adam: AdamOptions) {
    let all = golden();
    let case = &all[name];
    let names = ["encoder.0.0.weight", "descriptor.bias"];
    let device = Device::flex();
    // Only the two tensors of the case get a gradient; they fill the start of the network's own.
    let mut parameters =
        Parameters::of_model(&Model::random(&NetSpec::compact(), 1).unwrap(), &device);
    let length = |parameters: &Parameters, name: &str| parameters.flat(name).unwrap().dims()[0];
    let padded = |values: Vec<f32>, to: usize| {
        let mut values = values;
        values.resize(to, 0.0);
        values
    };
    for name in names {
        let to = length(&parameters, name);
        let value = padded(numbers(&case["start"][name]), to);
        parameters.set(name, tensor(value, [to], &device)).unwrap();
    }
    let options = StepOptions { adam, clip };
    let mut adam = Adam::default();
    for (pull, expected) in case["pulls"]
        .as_array()
        .unwrap()
        .iter()
        .zip(numbers(&case["lengths"]))
    {
        let tracked = parameters.tracked();
        let sum = names.map(|name| {
            let to = length(&parameters, name);
            let pull = tensor(
                padded(numbers(&pull[name]), to),
                [to],
                &device.clone().autodiff(),
            );
            (tracked.flat(name).unwrap() * pull).sum()
        });
        let [a, b] = sum;
        let mut gradients = (a + b).backward();
        let rate = |name: &str| {
            if name.starts_with("encoder.") {
                1e-3
            } else {
                1e-2
            }
        };
        let found = adam
            .step(&mut parameters, &tracked, &mut gradients, &options, rate)
            .unwrap();
        close(&[found], &[expected], "gradient length");
    }
    for name in names {
        let theirs = numbers(&case["end"][name]);
        let ours = host(parameters.flat(name).unwrap());
        close(&ours[..theirs.len()], &theirs, name);
    }
}

/// Where tasks alternate, a decoder has its first gradient after other tensors had many: its first step is the learning rate, as in PyTorch,
/// which counts the updates of each tensor by itself.
#[test]
fn the_first_step_of_a_tensor_has_the_length_of_the_rate_whenever_it_comes() {
    let device = Device::flex();
    let mut parameters =
        Parameters::of_model(&Model::random(&NetSpec::compact(), 1).unwrap(), &device);
    let options = StepOptions {
        adam: AdamOptions::pytorch(),
        clip: f32::INFINITY,
    };
    let mut adam = Adam::default();
    let mut step = |name: &str| {
        let before = host(parameters.flat(name).unwrap());
        let tracked = parameters.tracked();
        let mut gradients = tracked.flat(name).unwrap().sum().backward();
        adam.step(&mut parameters, &tracked, &mut gradients, &options, |_| {
            0.01
        })
        .unwrap();
        let after = host(parameters.flat(name).unwrap());
        before[0] - after[0]
    };
    for _ in 0..20 {
        step("encoder.0.0.weight");
    }
    close(&[step("descriptor.bias")], &[0.01], "first step");
}
