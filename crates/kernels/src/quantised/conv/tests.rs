//! Against the plain definition, byte for byte, with every set of instructions.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::*;

/// Input, weights and factors of a random convolution.
struct Case {
    spec: ConvSpec,
    height: usize,
    width: usize,
    zero: Vec<u8>,
    bytes: Vec<u8>,
    weights: QuantisedWeights,
    factors: Vec<f32>,
}

impl Case {
    fn new(spec: ConvSpec, height: usize, width: usize, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let weights = QuantisedWeights {
            values: (0..spec.weight_len())
                .map(|_| random.random_range(-127..=127))
                .collect(),
            start: (0..spec.out_channels)
                .map(|_| random.random_range(-20_000..20_000))
                .collect(),
            unit: vec![1.0; spec.out_channels],
        };
        Self {
            spec,
            height,
            width,
            zero: (0..spec.in_channels).map(|_| random.random()).collect(),
            bytes: (0..spec.in_channels * height * width)
                .map(|_| random.random())
                .collect(),
            weights,
            factors: (0..spec.out_channels)
                .map(|_| random.random_range(1e-4..3e-3))
                .collect(),
        }
    }

    /// The sums by the definition, `height x width x out`.
    fn sums(&self) -> Vec<i32> {
        let ConvSpec {
            in_channels,
            out_channels,
            kernel,
            stride,
        } = self.spec;
        let half = kernel / 2;
        let mut sums = Vec::new();
        for (y, x) in (0..self.spec.output_size(self.height))
            .flat_map(|y| (0..self.spec.output_size(self.width)).map(move |x| (y, x)))
        {
            for o in 0..out_channels {
                let mut sum = self.weights.start[o];
                for (dy, dx) in (0..kernel).flat_map(|dy| (0..kernel).map(move |dx| (dy, dx))) {
                    let (at_y, at_x) = (
                        (y * stride + dy).wrapping_sub(half),
                        (x * stride + dx).wrapping_sub(half),
                    );
                    for i in 0..in_channels {
                        let byte = if at_y < self.height && at_x < self.width {
                            self.bytes[(at_y * self.width + at_x) * in_channels + i]
                        } else {
                            self.zero[i]
                        };
                        let tap = ((o * in_channels + i) * kernel + dy) * kernel + dx;
                        sum += i32::from(byte) * i32::from(self.weights.values[tap]);
                    }
                }
                sums.push(sum);
            }
        }
        sums
    }

    fn check(&self) {
        let (spec, factors) = (self.spec, &self.factors);
        let expected: Vec<f32> = self
            .sums()
            .iter()
            .zip(factors.iter().cycle())
            .map(|(&sum, factor)| sum as f32 * factor)
            .collect();
        let rectified: Vec<u8> = self
            .sums()
            .iter()
            .zip(factors.iter().cycle())
            .map(|(&sum, factor)| (sum.max(0) as f32 * factor).round_ties_even().min(255.0) as u8)
            .collect();
        let input = ByteTensor::from_hwc(&self.bytes, self.height, self.width, &self.zero);
        let pitch = input.pixel_pitch();
        for dots in Dots::available() {
            let conv =
                QuantisedConv2d::with_dots(dots, spec, pitch, &self.weights, factors).unwrap();
            let mut bytes = ByteTensor::default();
            conv.forward_relu(&input, &mut bytes);
            assert!(bytes.to_hwc() == rectified, "{dots:?} {spec:?} {input:?}");
            if spec.out_channels > 4 {
                let mut floats = Tensor::default();
                conv.forward(&input, &mut floats);
                assert!(floats.to_hwc() == expected, "{dots:?} {spec:?} {input:?}");
            }
        }
    }
}

fn spec(in_channels: usize, out_channels: usize, kernel: usize, stride: usize) -> ConvSpec {
    ConvSpec {
        in_channels,
        out_channels,
        kernel,
        stride,
    }
}

#[test]
fn the_layers_of_the_network_are_exact() {
    for (seed, (spec, height, width)) in [
        (spec(16, 16, 3, 1), 12, 43),
        (spec(16, 48, 3, 2), 16, 32),
        (spec(48, 48, 3, 1), 9, 21),
        (spec(48, 128, 3, 2), 8, 26),
        (spec(128, 128, 3, 1), 5, 20),
        (spec(128, 128, 3, 2), 10, 10),
        (spec(128, 128, 1, 1), 4, 17),
        (spec(64, 65, 1, 1), 3, 11),
    ]
    .into_iter()
    .enumerate()
    {
        Case::new(spec, height, width, seed as u64).check();
    }
}

#[test]
fn all_shapes_are_exact() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for seed in 0..60 {
        let spec = spec(
            random.random_range(1..40),
            random.random_range(1..70),
            [1, 3][random.random_range(0..2)],
            random.random_range(1..3),
        );
        let (height, width) = (random.random_range(1..9), random.random_range(1..27));
        Case::new(spec, height, width, seed).check();
    }
}

#[test]
fn pictures_of_four_bytes_a_pixel_are_exact() {
    let case = Case::new(spec(3, 16, 3, 2), 10, 18, 5);
    let wide = ByteTensor::from_hwc(&case.bytes, 10, 18, &case.zero);
    let mut narrow = ByteTensor::default();
    narrow.reshape_picture(10, 18, [case.zero[0], case.zero[1], case.zero[2]]);
    narrow.par_rows_mut().enumerate().for_each(|(y, row)| {
        for (to, from) in row.chunks_exact_mut(4).zip(wide.row(y).chunks_exact(16)) {
            to[..3].copy_from_slice(&from[..3]);
            // What lies in the padding does not matter.
            to[3] = 77;
        }
    });
    for isa in Isa::available() {
        let (mut a, mut b) = (ByteTensor::default(), ByteTensor::default());
        let of = QuantisedConv2d::new(isa, case.spec, &case.weights, &case.factors).unwrap();
        of.forward_relu(&wide, &mut a);
        let picture =
            QuantisedConv2d::of_picture(isa, case.spec, &case.weights, &case.factors).unwrap();
        picture.forward_relu(&narrow, &mut b);
        assert!(a.to_hwc() == b.to_hwc(), "{isa}");
    }
}

#[test]
fn threads_do_not_change_the_bytes() {
    let case = Case::new(spec(48, 128, 3, 2), 40, 40, 9);
    let input = ByteTensor::from_hwc(&case.bytes, 40, 40, &case.zero);
    let conv =
        QuantisedConv2d::new(Isa::detect(), case.spec, &case.weights, &case.factors).unwrap();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let mut output = ByteTensor::default();
        pool.install(|| conv.forward_relu(&input, &mut output));
        output.to_hwc()
    };
    assert!(on(1) == on(3));
}
