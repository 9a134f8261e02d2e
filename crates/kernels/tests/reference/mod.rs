//! Plain f64 versions of the kernels, straight from the definitions, and how far a kernel may be from them.
#![allow(dead_code)]

use grimnet_kernels::ConvSpec;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Values in [-1, 1).
pub fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..len).map(|_| rng.random_range(-1.0..1.0)).collect()
}

/// What a kernel should have given, and the size that its rounding errors are measured against: the root of the sum of
/// the squared terms of an output, which is what an output of random terms amounts to, at its largest.
pub struct Expected {
    pub values: Vec<f64>,
    pub scale: f64,
}

impl Expected {
    fn of(outputs: impl Iterator<Item = (f64, f64)>) -> Self {
        let (values, squares): (Vec<f64>, Vec<f64>) = outputs.unzip();
        let scale = values
            .iter()
            .map(|v| v.abs())
            .chain(squares.iter().map(|s| s.sqrt()))
            .fold(1e-30, f64::max);
        Self { values, scale }
    }

    /// The largest error, relative to the scale.
    pub fn error(&self, got: &[f32]) -> f64 {
        assert_eq!(got.len(), self.values.len());
        let worst = got
            .iter()
            .zip(&self.values)
            .map(|(&g, &v)| (f64::from(g) - v).abs());
        worst.fold(
            0.0,
            |a, b| if b.is_nan() { f64::INFINITY } else { a.max(b) },
        ) / self.scale
    }

    pub fn relu(mut self) -> Self {
        self.values.iter_mut().for_each(|v| *v = v.max(0.0));
        self
    }
}

/// A sum of products as (sum, sum of squares).
#[derive(Default, Clone, Copy)]
struct Sum(f64, f64);
impl Sum {
    fn add(&mut self, a: f32, b: f32) {
        let term = f64::from(a) * f64::from(b);
        self.0 += term;
        self.1 += term * term;
    }
}

fn at(plane: &[f32], h: usize, w: usize, y: isize, x: isize) -> f32 {
    let inside = (0..h as isize).contains(&y) && (0..w as isize).contains(&x);
    if inside {
        plane[y as usize * w + x as usize]
    } else {
        0.0
    }
}

/// NCHW batch convolution.
pub fn conv(
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    x: &[f32],
    weight: &[f32],
    bias: &[f32],
) -> Expected {
    let (oh, ow, k, p) = (
        spec.output_size(h),
        spec.output_size(w),
        spec.kernel,
        (spec.kernel / 2) as isize,
    );
    Expected::of((0..batch * spec.out_channels * oh * ow).map(|out| {
        let (ox, oy, o, b) = (
            out % ow,
            out / ow % oh,
            out / (ow * oh) % spec.out_channels,
            out / (ow * oh * spec.out_channels),
        );
        let mut sum = Sum::default();
        for i in 0..spec.in_channels {
            let plane = &x[(b * spec.in_channels + i) * h * w..][..h * w];
            for (ky, kx) in (0..k * k).map(|tap| (tap / k, tap % k)) {
                let (y, x) = (
                    (oy * spec.stride + ky) as isize - p,
                    (ox * spec.stride + kx) as isize - p,
                );
                sum.add(
                    at(plane, h, w, y, x),
                    weight[((o * spec.in_channels + i) * k + ky) * k + kx],
                );
            }
        }
        (sum.0 + f64::from(bias[o]), sum.1)
    }))
}

/// Gradient of the batch convolution with respect to its input.
pub fn conv_grad_input(
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    grad_y: &[f32],
    weight: &[f32],
) -> Expected {
    let (oh, ow, k, p) = (
        spec.output_size(h),
        spec.output_size(w),
        spec.kernel,
        spec.kernel / 2,
    );
    let mut sums = vec![Sum::default(); batch * spec.in_channels * h * w];
    each_product(spec, batch, oh, ow, |b, o, i, oy, ox, tap| {
        let (y, x) = (
            (oy * spec.stride + tap / k).wrapping_sub(p),
            (ox * spec.stride + tap % k).wrapping_sub(p),
        );
        if y < h && x < w {
            sums[((b * spec.in_channels + i) * h + y) * w + x].add(
                grad_y[((b * spec.out_channels + o) * oh + oy) * ow + ox],
                weight[(o * spec.in_channels + i) * k * k + tap],
            );
        }
    });
    Expected::of(sums.into_iter().map(|s| (s.0, s.1)))
}

/// Gradient of the batch convolution with respect to its weight.
pub fn conv_grad_weight(
    spec: ConvSpec,
    batch: usize,
    h: usize,
    w: usize,
    x: &[f32],
    grad_y: &[f32],
) -> Expected {
    let (oh, ow, k, p) = (
        spec.output_size(h),
        spec.output_size(w),
        spec.kernel,
        (spec.kernel / 2) as isize,
    );
    let mut sums = vec![Sum::default(); spec.weight_len()];
    each_product(spec, batch, oh, ow, |b, o, i, oy, ox, tap| {
        let (iy, ix) = (
            (oy * spec.stride + tap / k) as isize - p,
            (ox * spec.stride + tap % k) as isize - p,
        );
        let plane = &x[(b * spec.in_channels + i) * h * w..][..h * w];
        sums[(o * spec.in_channels + i) * k * k + tap].add(
            at(plane, h, w, iy, ix),
            grad_y[((b * spec.out_channels + o) * oh + oy) * ow + ox],
        );
    });
    Expected::of(sums.into_iter().map(|s| (s.0, s.1)))
}

fn each_product(
    spec: ConvSpec,
    batch: usize,
    oh: usize,
    ow: usize,
    mut visit: impl FnMut(usize, usize, usize, usize, usize, usize),
) {
    for b in 0..batch {
        for o in 0..spec.out_channels {
            for i in 0..spec.in_channels {
                for out in 0..oh * ow {
                    for tap in 0..spec.kernel * spec.kernel {
                        visit(b, o, i, out / ow, out % ow, tap);
                    }
                }
            }
        }
    }
}

/// Transposed convolution 4x4, stride 2, padding 1 by scattering, CHW. `weight` is `[in, out, 4, 4]`.
pub fn conv_transpose(
    ci: usize,
    co: usize,
    h: usize,
    w: usize,
    x: &[f32],
    weight: &[f32],
    bias: &[f32],
) -> Expected {
    let mut sums = vec![Sum::default(); co * 4 * h * w];
    for i in 0..ci {
        for o in 0..co {
            for (y, x_) in (0..h * w).map(|n| (n / w, n % w)) {
                for (ky, kx) in (0..16).map(|tap| (tap / 4, tap % 4)) {
                    let (oy, ox) = ((2 * y + ky).wrapping_sub(1), (2 * x_ + kx).wrapping_sub(1));
                    if oy < 2 * h && ox < 2 * w {
                        sums[(o * 2 * h + oy) * 2 * w + ox].add(
                            x[(i * h + y) * w + x_],
                            weight[((i * co + o) * 4 + ky) * 4 + kx],
                        );
                    }
                }
            }
        }
    }
    Expected::of(
        sums.into_iter()
            .enumerate()
            .map(|(n, s)| (s.0 + f64::from(bias[n / (4 * h * w)]), s.1)),
    )
}

/// `a b^T` of `m x k` and `n x k`.
pub fn matmul_nt(m: usize, n: usize, k: usize, a: &[f32], b: &[f32]) -> Expected {
    Expected::of((0..m * n).map(|out| {
        let mut sum = Sum::default();
        (0..k).for_each(|l| sum.add(a[out / n * k + l], b[out % n * k + l]));
        (sum.0, sum.1)
    }))
}
