//! Training kernels: forward and gradients against f64, and the gradients against the slopes of the forward.

mod reference;

use grimnet_kernels::train::{BatchConvSpec, conv3x3, conv3x3_grad_input, conv3x3_grad_weight};
use grimnet_kernels::{ConvSpec, Isa};
use proptest::prelude::*;
use reference::random;

const TOLERANCE: f64 = 1e-5;

/// `[batch, rows, columns]` to `[batch, columns, rows]`.
fn transposed(values: &[f32], batch: usize, rows: usize, columns: usize) -> Vec<f32> {
    assert_eq!(values.len(), batch * rows * columns);
    (0..values.len())
        .map(|i| {
            let (matrix, row, column) = (i / (rows * columns), i % rows, i / rows % columns);
            values[(matrix * rows + row) * columns + column]
        })
        .collect()
}

fn check(spec: BatchConvSpec, seed: u64) {
    let BatchConvSpec {
        batch,
        height,
        width,
        in_channels,
        out_channels,
    } = spec;
    let layer = ConvSpec {
        in_channels,
        out_channels,
        kernel: 3,
        stride: 1,
    };
    let pixels = height * width;
    let x = random(batch * in_channels * pixels, seed);
    let weight = random(spec.weight_len(), seed + 1);
    let grad_y = random(batch * out_channels * pixels, seed + 2);
    let zeros = vec![0.0; out_channels];
    let want_y = reference::conv(layer, batch, height, width, &x, &weight, &zeros);
    let want_x = reference::conv_grad_input(layer, batch, height, width, &grad_y, &weight);
    let want_weight = reference::conv_grad_weight(layer, batch, height, width, &x, &grad_y);
    let (x, grad_y) = (
        transposed(&x, batch, in_channels, pixels),
        transposed(&grad_y, batch, out_channels, pixels),
    );
    for isa in Isa::available() {
        let mut y = vec![f32::NAN; grad_y.len()];
        conv3x3(isa, spec, &x, &weight, &mut y);
        let mut grad_x = vec![f32::NAN; x.len()];
        conv3x3_grad_input(isa, spec, &grad_y, &weight, &mut grad_x);
        let mut grad_weight = vec![f32::NAN; weight.len()];
        conv3x3_grad_weight(isa, spec, &x, &grad_y, &mut grad_weight);
        let y = transposed(&y, batch, pixels, out_channels);
        let grad_x = transposed(&grad_x, batch, pixels, in_channels);
        for (what, error) in [
            ("forward", want_y.error(&y)),
            ("input gradient", want_x.error(&grad_x)),
            ("weight gradient", want_weight.error(&grad_weight)),
        ] {
            assert!(error < TOLERANCE, "{isa} {what} of {spec:?}: {error:e}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn forward_and_gradients_equal_f64(
        in_channels in 1usize..40, out_channels in 1usize..40, batch in 0usize..4, height in 1usize..20, width in 1usize..20,
        seed: u32,
    ) {
        check(BatchConvSpec { batch, height, width, in_channels, out_channels }, seed.into());
    }
}

/// Shapes large enough to be cut into several blocks in every direction.
#[test]
fn larger_layers_equal_f64() {
    for (in_channels, out_channels, height, width) in
        [(3, 64, 50, 50), (64, 80, 33, 50), (144, 160, 20, 30)]
    {
        let spec = BatchConvSpec {
            batch: 2,
            height,
            width,
            in_channels,
            out_channels,
        };
        check(spec, 5);
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
    let spec = BatchConvSpec {
        batch: 2,
        height: 13,
        width: 14,
        in_channels: 18,
        out_channels: 20,
    };
    let pixels = spec.batch * spec.height * spec.width;
    let (x, dx) = (random(18 * pixels, 1), random(18 * pixels, 2));
    let (weight, dw) = (random(spec.weight_len(), 3), random(spec.weight_len(), 4));
    let grad_y = random(20 * pixels, 5);
    for isa in Isa::available() {
        let value = |t: f32| {
            let moved =
                |a: &[f32], d: &[f32]| a.iter().zip(d).map(|(a, d)| a + t * d).collect::<Vec<_>>();
            let mut y = vec![0.0; grad_y.len()];
            conv3x3(isa, spec, &moved(&x, &dx), &moved(&weight, &dw), &mut y);
            dot(&y, &grad_y)
        };
        let mut grad_x = vec![0.0; x.len()];
        conv3x3_grad_input(isa, spec, &grad_y, &weight, &mut grad_x);
        let mut grad_weight = vec![0.0; weight.len()];
        conv3x3_grad_weight(isa, spec, &x, &grad_y, &mut grad_weight);
        // The value is quadratic in t, so the central difference is exact for any step.
        let slope = value(0.5) - value(-0.5);
        let want = dot(&grad_x, &dx) + dot(&grad_weight, &dw);
        let size = (dot(&grad_x, &grad_x) + dot(&grad_weight, &grad_weight)).sqrt();
        assert!(
            (slope - want).abs() < 1e-4 * size,
            "{isa}: {slope} for {want}"
        );
    }
}

#[test]
#[should_panic(expected = "elements of the weight")]
fn weights_of_more_channels_than_fit_the_address_space_are_refused() {
    // A batch without images has no elements, however many channels it has.
    let spec = BatchConvSpec {
        batch: 0,
        height: 4,
        width: 4,
        in_channels: usize::MAX / 9 + 1,
        out_channels: 5,
    };
    let weight = vec![0.0; 5 * spec.in_channels.wrapping_mul(9)];
    conv3x3(Isa::Portable, spec, &[], &weight, &mut []);
}
