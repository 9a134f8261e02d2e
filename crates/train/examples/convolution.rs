//! Times the trainer's own convolution against grimnet-kernels' on the layers of `compact`, 24 pictures of 224 x 224.

#![allow(clippy::print_stdout)]

use grimnet_kernels::{ConvSpec, Isa, train};
use grimnet_train::ops::convolution::{Geometry, forward, grad_input, grad_weight};
use std::time::Instant;

fn main() {
    let best = |f: &mut dyn FnMut()| {
        (0..4)
            .map(|_| {
                let start = Instant::now();
                f();
                start.elapsed().as_secs_f64() * 1e3
            })
            .fold(f64::MAX, f64::min)
    };
    for (side, inc, outc, stride) in [
        (224, 3, 16, 2),
        (112, 16, 16, 1),
        (112, 16, 48, 2),
        (56, 48, 48, 1),
        (56, 48, 128, 2),
        (28, 128, 128, 1),
        (14, 128, 128, 1),
    ] {
        let g = Geometry {
            batch: 24,
            height: side,
            width: side,
            in_channels: inc,
            out_channels: outc,
            stride,
        };
        let (x, w) = (
            vec![0.5f32; g.batch * g.input_len()],
            vec![0.1f32; g.weight_len()],
        );
        let mut y = vec![0.0f32; g.batch * g.output_len()];
        let (mut gx, mut gw) = (x.clone(), w.clone());
        let spec = ConvSpec {
            in_channels: inc,
            out_channels: outc,
            kernel: 3,
            stride,
        };
        let isa = Isa::detect();
        println!(
            "{side} {inc}->{outc} /{stride}: ours {:.1} {:.1} {:.1} ms, kernels {:.1} {:.1} {:.1} ms (forward, input, weight)",
            best(&mut || drop(forward(&g, &x, &w))),
            best(&mut || drop(grad_input(&g, &y, &w))),
            best(&mut || drop(grad_weight(&g, &x, &y))),
            best(&mut || train::conv2d(isa, spec, 24, side, side, &x, &w, &mut y)),
            best(&mut || train::conv2d_grad_input(isa, spec, 24, side, side, &y, &w, &mut gx)),
            best(&mut || train::conv2d_grad_weight(isa, spec, 24, side, side, &x, &y, &mut gw)),
        );
    }
}
