//! Training kernels: forward and gradients against f64, and the gradients against finite differences of the forward.

mod reference;

use grimnet_kernels::{ConvSpec, Isa, train};
use proptest::prelude::*;
use reference::random;

const TOLERANCE: f64 = 1e-5;

#[derive(Debug, Clone, Copy)]
struct Case {
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    seed: u64,
}

fn check(case: Case) {
    let Case {
        spec,
        batch,
        h,
        w,
        seed,
    } = case;
    let x = random(batch * spec.in_channels * h * w, seed);
    let weight = random(spec.weight_len(), seed + 1);
    let grad_y = random(
        batch * spec.out_channels * spec.output_size(h) * spec.output_size(w),
        seed + 2,
    );
    let zeros = vec![0.0; spec.out_channels];
    let want_y = reference::conv(spec, batch, h, w, &x, &weight, &zeros);
    let want_x = reference::conv_grad_input(spec, batch, h, w, &grad_y, &weight);
    let want_weight = reference::conv_grad_weight(spec, batch, h, w, &x, &grad_y);
    for isa in Isa::available() {
        let mut y = vec![f32::NAN; grad_y.len()];
        train::conv2d(isa, spec, batch, h, w, &x, &weight, &mut y);
        let mut grad_x = vec![f32::NAN; x.len()];
        train::conv2d_grad_input(isa, spec, batch, h, w, &grad_y, &weight, &mut grad_x);
        let mut grad_weight = vec![f32::NAN; weight.len()];
        train::conv2d_grad_weight(isa, spec, batch, h, w, &x, &grad_y, &mut grad_weight);
        for (what, error) in [
            ("forward", want_y.error(&y)),
            ("input gradient", want_x.error(&grad_x)),
            ("weight gradient", want_weight.error(&grad_weight)),
        ] {
            assert!(error < TOLERANCE, "{isa} {what} of {case:?}: {error:e}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn forward_and_gradients_equal_f64(
        ci in 1usize..40, co in 1usize..40, kernel in prop_oneof![Just(1usize), Just(3)], stride in 1usize..=2,
        batch in 0usize..4, h in 1usize..20, w in 1usize..20, seed: u32,
    ) {
        let spec = ConvSpec { in_channels: ci, out_channels: co, kernel, stride };
        check(Case { spec, batch, h, w, seed: seed.into() });
    }
}

/// Shapes large enough to be cut into several blocks in every direction.
#[test]
fn larger_layers_equal_f64() {
    for (in_channels, out_channels, kernel, stride, h, w) in [
        (3, 64, 3, 1, 50, 50),
        (64, 80, 3, 1, 33, 50),
        (48, 100, 3, 2, 41, 40),
        (100, 65, 1, 1, 20, 30),
    ] {
        let spec = ConvSpec {
            in_channels,
            out_channels,
            kernel,
            stride,
        };
        check(Case {
            spec,
            batch: 2,
            h,
            w,
            seed: 5,
        });
    }
}

/// d/dt of `<grad_y, conv(x + t dx, w + t dw)>` is `<grad_x, dx> + <grad_w, dw>`.
#[test]
fn gradients_are_the_slopes_of_the_forward() {
    let dot = |a: &[f32], b: &[f32]| {
        a.iter()
            .zip(b)
            .map(|(&a, &b)| f64::from(a) * f64::from(b))
            .sum::<f64>()
    };
    for (kernel, stride) in [(3, 1), (3, 2), (1, 1), (1, 2)] {
        let spec = ConvSpec {
            in_channels: 18,
            out_channels: 20,
            kernel,
            stride,
        };
        let (batch, h, w) = (2, 13, 14);
        let (x, dx) = (random(batch * 18 * h * w, 1), random(batch * 18 * h * w, 2));
        let (weight, dw) = (random(spec.weight_len(), 3), random(spec.weight_len(), 4));
        let grad_y = random(batch * 20 * spec.output_size(h) * spec.output_size(w), 5);
        for isa in Isa::available() {
            let value = |t: f32| {
                let moved = |a: &[f32], d: &[f32]| {
                    a.iter().zip(d).map(|(a, d)| a + t * d).collect::<Vec<_>>()
                };
                let mut y = vec![0.0; grad_y.len()];
                train::conv2d(
                    isa,
                    spec,
                    batch,
                    h,
                    w,
                    &moved(&x, &dx),
                    &moved(&weight, &dw),
                    &mut y,
                );
                dot(&y, &grad_y)
            };
            let mut grad_x = vec![0.0; x.len()];
            train::conv2d_grad_input(isa, spec, batch, h, w, &grad_y, &weight, &mut grad_x);
            let mut grad_weight = vec![0.0; weight.len()];
            train::conv2d_grad_weight(isa, spec, batch, h, w, &x, &grad_y, &mut grad_weight);
            // The value is quadratic in t, so the central difference is exact for any step.
            let slope = value(0.5) - value(-0.5);
            let want = dot(&grad_x, &dx) + dot(&grad_weight, &dw);
            let size = (dot(&grad_x, &grad_x) + dot(&grad_weight, &grad_weight)).sqrt();
            assert!(
                (slope - want).abs() < 1e-4 * size,
                "{isa} {kernel}x{kernel}/{stride}: {slope} for {want}"
            );
        }
    }
}
