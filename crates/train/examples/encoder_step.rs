//! Times one training step through the VGG-16 encoder, forward and backward: `encoder_step [SIDE_PX [PICTURES]]`.
//! `benches/peers/encoder_step.py` times PyTorch's.

#![allow(clippy::print_stdout)]

use burn::tensor::module::max_pool2d;
use burn::tensor::ops::MaxPoolOptions;
use burn::tensor::{Device, Distribution, Tensor};
use grimnet_net::NetSpec;
use grimnet_train::ops::{Group, conv3x3, norm_relu};
use std::sync::Arc;
use std::time::Instant;

const RUNS: usize = 5;

struct Layer {
    weight: Tensor<4>,
    gamma: Tensor<2>,
    beta: Tensor<2>,
}

fn layer(inputs: usize, outputs: usize, device: &Device) -> Layer {
    let bound = (6.0 / (9 * inputs) as f64).sqrt();
    let uniform = Distribution::Uniform(-bound, bound);
    Layer {
        weight: Tensor::random([outputs, inputs, 3, 3], uniform, device).require_grad(),
        gamma: Tensor::ones([2, outputs], device).require_grad(),
        beta: Tensor::zeros([2, outputs], device).require_grad(),
    }
}

/// Half the pictures are of either domain.
fn forward(stages: &[Vec<Layer>], pictures: Tensor<4>) -> Tensor<4> {
    let mut x = pictures;
    for stage in stages {
        for layer in stage {
            let y = conv3x3(x, layer.weight.clone(), 1);
            let [n, h, w, c] = y.dims();
            let group = |domain| Group {
                rows: n / 2 * h * w,
                domain,
            };
            let groups = Arc::new(vec![group(0), group(1)]);
            let rows = y.reshape([n * h * w, c]);
            let (y, ..) = norm_relu(rows, layer.gamma.clone(), layer.beta.clone(), &groups, 1e-5);
            x = y.reshape([n, h, w, c]);
        }
        let pooled = max_pool2d(x.permute([0, 3, 1, 2]), MaxPoolOptions::new([2, 2]));
        x = pooled.permute([0, 2, 3, 1]);
    }
    x
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(|a| a.parse::<usize>());
    let side = arguments.next().transpose()?.unwrap_or(256);
    let count = arguments.next().transpose()?.unwrap_or(2);
    let device = Device::flex().autodiff();
    let mut inputs = 3;
    let mut stages = Vec::new();
    for stage in NetSpec::vgg16().stages {
        let mut layers = Vec::new();
        for outputs in stage.widths {
            layers.push(layer(inputs, outputs, &device));
            inputs = outputs;
        }
        stages.push(layers);
    }
    let pictures = Tensor::random(
        [count, side, side, 3],
        Distribution::Normal(0.0, 1.0),
        &device,
    );
    let mut times = Vec::new();
    for _ in 0..=RUNS {
        let start = Instant::now();
        let loss = forward(&stages, pictures.clone()).square().mean();
        let middle = start.elapsed();
        let gradients = loss.backward();
        let first = stages[0][0].weight.grad(&gradients).ok_or("no gradient")?;
        let check = first.abs().sum().try_into_vec_as::<f32>()?;
        times.push((
            start.elapsed().as_secs_f64() * 1e3,
            middle.as_secs_f64() * 1e3,
        ));
        if !check[0].is_finite() {
            return Err("the gradient is not finite".into());
        }
    }
    times.remove(0);
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (best, median) = (times[0], times[RUNS / 2]);
    println!(
        "{count} x {side} x {side}: best {:.0} ms (forward {:.0}), median {:.0} ms",
        best.0, best.1, median.0
    );
    Ok(())
}
