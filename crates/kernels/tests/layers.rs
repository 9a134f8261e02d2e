//! Inference kernels against f64 on random shapes, for every instruction set that the machine has.

#![allow(clippy::unwrap_used)]

mod reference;

use grimnet_kernels::{
    Activation, Conv2d, ConvSpec, ConvTranspose2d, Isa, KernelError, Tensor, Workspace,
    channel_moments, max_pool_2x2, scale_shift, upsample_bilinear_add,
};
use proptest::prelude::*;
use reference::random;

/// Largest error allowed, relative to the largest output: Winograd F(4x4,3x3) costs the most digits.
const TOLERANCE: f64 = 1e-5;

/// The worst error of each instruction set.
fn conv_errors(
    spec: ConvSpec,
    h: usize,
    w: usize,
    activation: Activation,
    seed: u64,
) -> Vec<(Isa, f64)> {
    let x = random(spec.in_channels * h * w, seed);
    let weight = random(spec.weight_len(), seed + 1);
    let bias = random(spec.out_channels, seed + 2);
    let mut expected = reference::conv(spec, 1, h, w, &x, &weight, &bias);
    if activation == Activation::Relu {
        expected = expected.relu();
    }
    let input = Tensor::from_chw(&x, spec.in_channels, h, w);
    let error = |isa| {
        let conv = Conv2d::new(isa, spec, &weight, &bias, activation).unwrap();
        let mut output = Tensor::default();
        conv.forward(&input, &mut output, &mut Workspace::new());
        assert_eq!(
            (output.height(), output.width()),
            (spec.output_size(h), spec.output_size(w))
        );
        (isa, expected.error(&output.to_chw()))
    };
    Isa::available().into_iter().map(error).collect()
}

fn activations() -> impl Strategy<Value = Activation> {
    prop_oneof![Just(Activation::Identity), Just(Activation::Relu)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn conv_equals_f64(
        ci in 1usize..70, co in 1usize..70, kernel in prop_oneof![Just(1usize), Just(3)], stride in 1usize..=2,
        h in 1usize..30, w in 1usize..30, activation in activations(), seed: u32,
    ) {
        let spec = ConvSpec { in_channels: ci, out_channels: co, kernel, stride };
        for (isa, error) in conv_errors(spec, h, w, activation, seed.into()) {
            prop_assert!(error < TOLERANCE, "{isa}: {error:e}");
        }
    }

    #[test]
    fn conv_transpose_equals_f64(ci in 1usize..40, co in 1usize..40, h in 1usize..12, w in 1usize..20, seed: u32) {
        let (seed, len) = (u64::from(seed), ci * co * 16);
        let (x, weight, bias) = (random(ci * h * w, seed), random(len, seed + 1), random(co, seed + 2));
        let expected = reference::conv_transpose(ci, co, h, w, &x, &weight, &bias);
        for isa in Isa::available() {
            let conv = ConvTranspose2d::new(isa, ci, co, &weight, &bias, Activation::Identity).unwrap();
            let mut output = Tensor::default();
            conv.forward(&Tensor::from_chw(&x, ci, h, w), &mut output, &mut Workspace::new());
            let error = expected.error(&output.to_chw());
            prop_assert!(error < TOLERANCE, "{isa}: {error:e}");
        }
    }

    #[test]
    fn max_pool_takes_the_largest_of_four(c in 1usize..40, h in 1usize..20, w in 1usize..20, seed: u32) {
        let x = random(c * h * w, seed.into());
        let input = Tensor::from_chw(&x, c, h, w);
        for isa in Isa::available() {
            let mut output = Tensor::default();
            max_pool_2x2(isa, &input, &mut output);
            prop_assert_eq!((output.height(), output.width()), (h / 2, w / 2));
            for (i, got) in output.to_chw().into_iter().enumerate() {
                let (ox, oy, plane) = (i % (w / 2), i / (w / 2) % (h / 2), i / (h / 2 * (w / 2)));
                let four = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(dy, dx)| x[(plane * h + 2 * oy + dy) * w + 2 * ox + dx]);
                prop_assert_eq!(got, four.into_iter().fold(f32::MIN, f32::max));
            }
        }
    }

    #[test]
    fn upsampling_adds_the_bilinear_image(
        c in 1usize..40, h in 1usize..9, w in 1usize..9, oh in 1usize..30, ow in 1usize..30, seed: u32,
    ) {
        let (src, dst) = (random(c * h * w, seed.into()), random(c * oh * ow, u64::from(seed) + 1));
        let linear = |out: usize, size: usize, from: usize| {
            let at = ((out as f64 + 0.5) * from as f64 / size as f64 - 0.5).clamp(0.0, (from - 1) as f64);
            (at.floor() as usize, (at.floor() as usize + 1).min(from - 1), at.fract())
        };
        for isa in Isa::available() {
            let mut output = Tensor::from_chw(&dst, c, oh, ow);
            upsample_bilinear_add(isa, &Tensor::from_chw(&src, c, h, w), &mut output);
            for (i, got) in output.to_chw().into_iter().enumerate() {
                let (x, y, plane) = (i % ow, i / ow % oh, i / (ow * oh));
                let ((x0, x1, fx), (y0, y1, fy)) = (linear(x, ow, w), linear(y, oh, h));
                let at = |y: usize, x: usize| f64::from(src[(plane * h + y) * w + x]);
                let row = |y: usize| at(y, x0) * (1.0 - fx) + at(y, x1) * fx;
                let want = f64::from(dst[i]) + row(y0) * (1.0 - fy) + row(y1) * fy;
                prop_assert!((f64::from(got) - want).abs() < 1e-5, "{isa}: {got} for {want}");
            }
        }
    }

    #[test]
    fn scale_shift_is_affine(c in 1usize..40, h in 1usize..9, w in 1usize..9, activation in activations(), seed: u32) {
        let seed = u64::from(seed);
        let (x, scale, shift) = (random(c * h * w, seed), random(c, seed + 1), random(c, seed + 2));
        for isa in Isa::available() {
            let mut tensor = Tensor::from_chw(&x, c, h, w);
            scale_shift(isa, &mut tensor, &scale, &shift, activation);
            for (i, got) in tensor.to_chw().into_iter().enumerate() {
                let c = i / (h * w);
                let want = activation.apply(x[i] * scale[c] + shift[c]);
                prop_assert!((got - want).abs() < 1e-6);
            }
            // Halo and padding stay zero: a convolution of ones sees only what is inside.
            let spec = ConvSpec { in_channels: c, out_channels: 1, kernel: 3, stride: 1 };
            let ones = vec![1.0; spec.weight_len()];
            let conv = Conv2d::new(isa, spec, &ones, &[0.0], Activation::Identity).unwrap();
            let mut sums = Tensor::default();
            conv.forward(&tensor, &mut sums, &mut Workspace::new());
            let expected = reference::conv(spec, 1, h, w, &tensor.to_chw(), &ones, &[0.0]);
            prop_assert!(expected.error(&sums.to_chw()) < TOLERANCE);
        }
    }
}

/// The layers of the two networks, at sizes small enough for the f64 reference.
#[test]
fn network_layers_equal_f64() {
    let conv = |in_channels, out_channels, kernel, stride| ConvSpec {
        in_channels,
        out_channels,
        kernel,
        stride,
    };
    let layers = [
        (conv(3, 16, 3, 2), 30, 34),
        (conv(3, 64, 3, 1), 20, 20),
        (conv(16, 16, 3, 1), 32, 32),
        (conv(16, 48, 3, 2), 32, 32),
        (conv(48, 48, 3, 1), 20, 22),
        (conv(48, 128, 3, 2), 20, 20),
        (conv(128, 128, 3, 1), 20, 20),
        (conv(128, 128, 3, 1), 10, 10),
        (conv(128, 128, 3, 2), 20, 20),
        (conv(128, 128, 1, 1), 20, 20),
        (conv(64, 65, 1, 1), 20, 20),
        (conv(512, 512, 3, 1), 5, 5),
        (conv(512, 65, 3, 1), 12, 12),
        (conv(512, 256, 3, 1), 8, 12),
    ];
    for (spec, h, w) in layers {
        for (isa, error) in conv_errors(spec, h, w, Activation::Identity, 7) {
            assert!(error < TOLERANCE, "{isa} {spec:?} {h}x{w}: {error:e}");
        }
    }
}

#[test]
fn moments_are_those_of_the_visible_pixels() {
    let (c, h, w) = (21, 9, 13);
    let x = random(c * h * w, 3);
    let mask: Vec<u8> = (0..h * w)
        .map(|i| if i % 3 == 0 { 255 } else { 0 })
        .collect();
    let tensor = Tensor::from_chw(&x, c, h, w);
    for isa in Isa::available() {
        for mask in [None, Some(mask.as_slice())] {
            let (mean, variance) = channel_moments(isa, &tensor, mask);
            for c in 0..c {
                let seen: Vec<f64> = (0..h * w)
                    .filter(|&i| mask.is_none_or(|mask| mask[i] != 0))
                    .map(|i| f64::from(x[c * h * w + i]))
                    .collect();
                let m = seen.iter().sum::<f64>() / seen.len() as f64;
                let v = seen.iter().map(|x| (x - m).powi(2)).sum::<f64>() / seen.len() as f64;
                assert!((f64::from(mean[c]) - m).abs() < 1e-6, "{isa}");
                assert!((f64::from(variance[c]) - v).abs() < 1e-6, "{isa}");
            }
        }
        let (mean, variance) = channel_moments(isa, &tensor, Some(&vec![0; h * w]));
        assert!(mean.iter().all(|&m| m == 0.0) && variance.iter().all(|&v| v == 1.0));
    }
}

#[test]
fn weights_of_more_channels_than_fit_the_address_space_are_refused() {
    // The least number whose nine taps wrap around, to a few weights.
    let in_channels = usize::MAX / 9 + 1;
    let spec = ConvSpec {
        in_channels,
        out_channels: 5,
        kernel: 3,
        stride: 1,
    };
    let weight = vec![0.0; 5 * in_channels.wrapping_mul(9)];
    let refused = Conv2d::new(
        Isa::Portable,
        spec,
        &weight,
        &[0.0; 5],
        Activation::Identity,
    );
    let expected = KernelError::WeightLength {
        expected: usize::MAX,
        found: weight.len(),
    };
    assert_eq!(refused.err(), Some(expected));
}
