//! The operations composed of burn's, for devices other than the CPU.
//!
//! Convolutions are matrix products with gathered windows: of f32, burn's own are direct ones on a GPU without tensor cores for it.

use super::normalisation::Group;
use burn::tensor::ops::PadMode;
use burn::tensor::{Tensor, s};

/// Most values of the windows gathered for one product: a buffer of a GPU holds less than 2 GiB.
const WINDOW_VALUES: usize = 1 << 28;

/// Rows and columns of a result that one workgroup computes in burn's products of f32.
const TILE: [usize; 2] = [256, 128];
/// So many tiles keep a large GPU busy.
const BUSY_TILES: usize = 512;

/// Most parts of the rows whose means are taken side by side, before the mean of these: one sum for each channel would leave most of
/// a GPU idle.
const PARTS: usize = 1024;

/// The pixels of square windows, row by row, as rows of a matrix; `x` has its border already.
///
/// `side` is that of a window, `[top, left]` the first one's position; there are `[height, width]` windows, `stride` apart.
fn windows(
    x: &Tensor<4>,
    side: usize,
    [top, left]: [usize; 2],
    [height, width]: [usize; 2],
    stride: usize,
) -> Tensor<2> {
    let [n, _, _, c] = x.dims();
    let every = |first: usize, count: usize| {
        let end = first + (count - 1) * stride + 1;
        s![first..end; stride as isize]
    };
    // Columns first, then rows of these: fewer operations than one for each pixel of a window.
    let wide = (0..side).map(|i| x.clone().slice(s![.., .., every(left + i, width), ..]));
    let wide = Tensor::cat(wide.collect(), 3);
    let tall = (0..side).map(|i| wide.clone().slice(s![.., every(top + i, height)]));
    Tensor::cat(tall.collect(), 3).reshape([n * height * width, side * side * c])
}

/// The product of rows `[rows, k]` with `taps` `[k, o]`, as a batch of products with the same taps, so that the gradient of the taps, a
/// small matrix of sums over all rows, is the sum of those of the batch and does not leave most of a GPU idle (split-K).
fn product(rows: Tensor<2>, taps: Tensor<2>) -> Tensor<2> {
    let ([n, k], [_, o]) = (rows.dims(), taps.dims());
    let tiles = k.div_ceil(TILE[0]) * o.div_ceil(TILE[1]);
    let wanted = BUSY_TILES.div_ceil(tiles).next_power_of_two();
    let parts = wanted.min(1 << n.trailing_zeros());
    let batch = rows.reshape([parts, n / parts, k]);
    batch.matmul(taps.unsqueeze::<3>()).reshape([n, o])
}

/// `f` of as many pictures at a time as have [`WINDOW_VALUES`] values in their windows.
fn by_pictures(x: Tensor<4>, values: usize, f: impl Fn(Tensor<4>) -> Tensor<4>) -> Tensor<4> {
    let [n, h, w, _] = x.dims();
    let most = (WINDOW_VALUES / values.max(1)).max(1);
    let padded = x.pad([(0, 0), (1, 1), (1, 1), (0, 0)], PadMode::Constant(0.0));
    debug_assert_eq!(padded.dims()[1..3], [h + 2, w + 2]);
    let parts = (0..n).step_by(most);
    let parts: Vec<_> = parts
        .map(|first| f(padded.clone().narrow(0, first, most.min(n - first))))
        .collect();
    Tensor::cat(parts, 0)
}

/// As [`super::conv3x3`].
pub(super) fn composed_conv3x3(x: Tensor<4>, weight: Tensor<4>, stride: usize) -> Tensor<4> {
    let ([_, h, w, c], [o, ..]) = (x.dims(), weight.dims());
    let [height, width] = [h / stride, w / stride];
    let taps = weight.permute([2, 3, 1, 0]).reshape([9 * c, o]);
    by_pictures(x, height * width * 9 * c, |x| {
        let n = x.dims()[0];
        let rows = windows(&x, 3, [0, 0], [height, width], stride);
        product(rows, taps.clone()).reshape([n, height, width, o])
    })
}

/// As [`super::transposed_conv4x4`]: each of the four positions of a result within a pixel of `x` is a 2 x 2 convolution.
pub(super) fn composed_transposed_conv4x4(x: Tensor<4>, weight: Tensor<4>) -> Tensor<4> {
    let ([_, h, w, c], [_, o, ..]) = (x.dims(), weight.dims());
    // Row 2 i + p of the result takes rows i - 1 + p and i + p of `x` with the kernel's rows 3 - p and 1 - p.
    let phases: Vec<Tensor<2>> = (0..4)
        .map(|phase| {
            let (p, q) = (phase / 2, phase % 2);
            let taps = (0..4).map(|tap| {
                let (y, z) = (3 - p - 2 * (tap / 2), 3 - q - 2 * (tap % 2));
                let tap = weight.clone().slice(s![.., .., y..y + 1, z..z + 1]);
                tap.reshape([c, o])
            });
            Tensor::cat(taps.collect(), 0)
        })
        .collect();
    by_pictures(x, h * w * 4 * c, |x| {
        let n = x.dims()[0];
        let parts = phases.iter().enumerate().map(|(phase, taps)| {
            let rows = windows(&x, 2, [phase / 2, phase % 2], [h, w], 1);
            product(rows, taps.clone()).reshape([n * h, w, 1, o])
        });
        let parts: Vec<Tensor<4>> = parts.collect();
        let line = |p: usize| {
            Tensor::cat(parts[2 * p..2 * p + 2].to_vec(), 2).reshape([n * h, 1, 2 * w, o])
        };
        Tensor::cat(vec![line(0), line(1)], 1).reshape([n, 2 * h, 2 * w, o])
    })
}

/// As [`super::norm_relu`].
pub(super) fn composed_norm_relu(
    x: Tensor<2>,
    gamma: Tensor<2>,
    beta: Tensor<2>,
    groups: &[Group],
    eps: f32,
) -> (Tensor<2>, Tensor<2>, Tensor<2>) {
    let (mut out, mut means, mut variances) = (Vec::new(), Vec::new(), Vec::new());
    let channels = x.dims()[1];
    let mut start = 0;
    for group in groups {
        let parts = 1 << group.rows.trailing_zeros().min(PARTS.trailing_zeros());
        let rows = x.clone().narrow(0, start, group.rows);
        let rows = rows.reshape([group.rows / parts, parts, channels]);
        start += group.rows;
        let of_rows = |x: Tensor<3>| x.mean_dim(0).mean_dim(1);
        // One dimension at a time also on the way back: the gradient of a broadcast over both would be one sum for each channel.
        let for_rows = |x: Tensor<3>| x.expand([1, parts, channels]);
        let affine = |of: &Tensor<2>| {
            let of = of.clone().narrow(0, group.domain, 1);
            of.reshape([1, 1, channels])
        };
        let mean = of_rows(rows.clone());
        let centred = rows - for_rows(mean.clone());
        let variance = of_rows(centred.clone().square());
        let scale = affine(&gamma) / variance.clone().add_scalar(eps).sqrt();
        let y = (centred * for_rows(scale) + for_rows(affine(&beta))).clamp_min(0.0);
        out.push(y.reshape([group.rows, channels]));
        means.push(mean.without_autodiff().reshape([1, channels]));
        variances.push(variance.without_autodiff().reshape([1, channels]));
    }
    (
        Tensor::cat(out, 0),
        Tensor::cat(means, 0),
        Tensor::cat(variances, 0),
    )
}
