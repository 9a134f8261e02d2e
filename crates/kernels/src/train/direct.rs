//! Strided, 1x1 and narrow convolutions, image by image on [`Tensor`]s.

use crate::buffer::AlignedBuffer;
use crate::direct::DirectWeights;
use crate::layout::{Interleave, Separate};
use crate::panel::{Finish, PanelRun, PanelShape, Panels, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::tensor::channel_stride;
use crate::{Activation, ConvSpec, Isa, Tensor};

/// Pixels summed in registers before they are added to the gradient of a weight, and rows of it in a piece of work.
const PIXELS_IN_CHUNK: usize = 512;
const ROWS_IN_PIECE: usize = 48;

/// What the functions of this module keep between calls.
#[derive(Default)]
pub(super) struct Memory {
    input: Tensor,
    output: Tensor,
    packed: AlignedBuffer,
    sums: AlignedBuffer,
}

pub(super) fn conv2d(
    isa: Isa,
    spec: ConvSpec,
    (h, w): (usize, usize),
    x: &[f32],
    weight: &[f32],
    y: &mut [f32],
    memory: &mut Memory,
) {
    forward(
        isa,
        spec,
        (h, w),
        x,
        &DirectWeights::new(isa, spec, weight),
        y,
        memory,
    );
}

fn forward(
    isa: Isa,
    spec: ConvSpec,
    (h, w): (usize, usize),
    x: &[f32],
    weights: &DirectWeights,
    y: &mut [f32],
    memory: &mut Memory,
) {
    let (oh, ow) = (spec.output_size(h), spec.output_size(w));
    memory.input.reshape(h, w, spec.in_channels);
    memory.output.reshape(oh, ow, spec.out_channels);
    let bias = AlignedBuffer::zeroed(channel_stride(spec.out_channels));
    let images = x
        .chunks_exact(spec.in_channels * h * w)
        .zip(y.chunks_exact_mut(spec.out_channels * oh * ow));
    for (x, y) in images {
        tensor_from_planes(isa, x, &mut memory.input);
        weights.forward(
            &memory.input,
            &mut memory.output,
            bias.as_slice(),
            Activation::Identity,
        );
        planes_from_tensor(isa, &memory.output, y);
    }
}

pub(super) fn grad_input(
    isa: Isa,
    spec: ConvSpec,
    (h, w): (usize, usize),
    grad_y: &[f32],
    weight: &[f32],
    grad_x: &mut [f32],
    memory: &mut Memory,
) {
    let taps = spec.kernel * spec.kernel;
    if spec.stride == 1 {
        // The same convolution with the kernels turned and the channels exchanged.
        let turned = ConvSpec {
            in_channels: spec.out_channels,
            out_channels: spec.in_channels,
            kernel: spec.kernel,
            stride: 1,
        };
        let mut turned_weight = vec![0.0; weight.len()];
        for o in 0..spec.out_channels {
            for i in 0..spec.in_channels {
                for tap in 0..taps {
                    turned_weight[(i * spec.out_channels + o) * taps + taps - 1 - tap] =
                        weight[(o * spec.in_channels + i) * taps + tap];
                }
            }
        }
        forward(
            isa,
            turned,
            (h, w),
            grad_y,
            &DirectWeights::new(isa, turned, &turned_weight),
            grad_x,
            memory,
        );
        return;
    }
    let (oh, ow) = (spec.output_size(h), spec.output_size(w));
    memory.input.reshape(oh, ow, spec.out_channels);
    memory.output.reshape(h, w, spec.in_channels);
    let phases = phases(isa, spec, weight);
    let images = grad_y
        .chunks_exact(spec.out_channels * oh * ow)
        .zip(grad_x.chunks_exact_mut(spec.in_channels * h * w));
    for (grad_y, grad_x) in images {
        tensor_from_planes(isa, grad_y, &mut memory.input);
        scatter_phases(isa, spec, &phases, &memory.input, &mut memory.output);
        planes_from_tensor(isa, &memory.output, grad_x);
    }
}

/// Kernel rows (or columns) that reach inputs of a parity at stride 2, from the first output on:
/// `input = 2 * output + index - kernel / 2`.
fn kernel_indices(kernel: usize, parity: usize) -> &'static [usize] {
    match (kernel, parity) {
        (1, 0) => &[0],
        (3, 0) => &[1],
        (3, _) => &[2, 0],
        _ => &[],
    }
}

/// For each parity of input row and column, the kernels that reach it, depth `[row][column][out]`.
fn phases(isa: Isa, spec: ConvSpec, weight: &[f32]) -> [Panels; 4] {
    let columns = channel_stride(spec.in_channels);
    let isa = isa.for_stride(columns);
    std::array::from_fn(|phase| {
        let (ky, kx) = (
            kernel_indices(spec.kernel, phase / 2),
            kernel_indices(spec.kernel, phase % 2),
        );
        Panels::pack(
            isa,
            ky.len() * kx.len() * spec.out_channels,
            columns,
            |depth, i| {
                if i >= spec.in_channels {
                    return 0.0;
                }
                let (tap, o) = (depth / spec.out_channels, depth % spec.out_channels);
                let (ky, kx) = (ky[tap / kx.len()], kx[tap % kx.len()]);
                weight[((o * spec.in_channels + i) * spec.kernel + ky) * spec.kernel + kx]
            },
        )
    })
}

fn scatter_phases(
    isa: Isa,
    spec: ConvSpec,
    phases: &[Panels; 4],
    grad_y: &Tensor,
    grad_x: &mut Tensor,
) {
    let (h, w, row, pixel) = (
        grad_x.height(),
        grad_x.width(),
        grad_x.row_stride(),
        grad_x.channel_stride(),
    );
    let out = SharedMut::new(grad_x.as_mut_slice());
    let isa = isa.for_stride(pixel);
    let bias = AlignedBuffer::zeroed(pixel);
    for_each(&mut AlignedBuffer::default(), 0, h, |_, y| {
        for odd_x in 0..2usize {
            let weights = &phases[y % 2 * 2 + odd_x];
            let (ky, kx) = (
                kernel_indices(spec.kernel, y % 2),
                kernel_indices(spec.kernel, odd_x),
            );
            for panel in 0..weights.shape.count() {
                let start = weights.shape.start(panel);
                // SAFETY: the taps of an input pixel are the output pixel of half its coordinates and the next, at
                // most in the halo; each row belongs to one unit.
                let run = unsafe {
                    PanelRun {
                        a: grad_y.as_slice().as_ptr().add(grad_y.offset(y / 2 + 1, 1)),
                        row_stride: grad_y.channel_stride(),
                        depth_stride: 1,
                        taps: Taps {
                            rows: ky.len(),
                            row_step: grad_y.row_stride(),
                            columns: kx.len(),
                            column_step: grad_y.channel_stride(),
                        },
                        depth: spec.out_channels,
                        b: weights.panel(panel).as_ptr(),
                        b_stride: weights.shape.width(panel),
                        width: weights.shape.width(panel),
                        out: out.at((y + 1) * row + (odd_x + 1) * pixel + start),
                        out_stride: 2 * pixel,
                        rows: (w + 1 - odd_x) / 2,
                        finish: Finish::layer(&bias.as_slice()[start..], Activation::Identity),
                    }
                };
                isa.run(run);
            }
        }
    });
}

pub(super) fn grad_weight(
    isa: Isa,
    spec: ConvSpec,
    (h, w): (usize, usize),
    x: &[f32],
    grad_y: &[f32],
    grad_weight: &mut [f32],
    memory: &mut Memory,
) {
    let (oh, ow) = (spec.output_size(h), spec.output_size(w));
    let columns = channel_stride(spec.out_channels);
    let isa_out = isa.for_stride(columns);
    let shape = PanelShape::new(isa_out, columns);
    memory.input.reshape(h, w, spec.in_channels);
    let (pixel, row) = (memory.input.channel_stride(), memory.input.row_stride());
    // Neighbours in a row lie one after the other, so a kernel row is one run of products.
    let rows = spec.kernel * pixel;
    let sums = memory.sums.floats(spec.kernel * rows * columns);
    sums.fill(0.0);
    let sums_out = SharedMut::new(sums);
    let packed = memory.packed.floats(oh * ow * columns);
    let lines = (PIXELS_IN_CHUNK / ow.max(1)).clamp(1, oh.max(1));
    let halo = 1 - spec.kernel / 2;
    let images = x
        .chunks_exact(spec.in_channels * h * w)
        .zip(grad_y.chunks_exact(spec.out_channels * oh * ow));
    for (x, grad_y) in images {
        tensor_from_planes(isa, x, &mut memory.input);
        pack_pixels(isa_out, grad_y, spec.out_channels, shape, packed);
        let (input, packed) = (&memory.input, &*packed);
        let pieces = rows.div_ceil(ROWS_IN_PIECE);
        for_each(
            &mut AlignedBuffer::default(),
            0,
            spec.kernel * shape.count() * pieces,
            |_, unit| {
                let (ky, panel, piece) = (
                    unit / (shape.count() * pieces),
                    unit / pieces % shape.count(),
                    unit % pieces,
                );
                let (start, width) = (shape.start(panel), shape.width(panel));
                let first = piece * ROWS_IN_PIECE;
                for y in (0..oh).step_by(lines) {
                    // SAFETY: pixels of the haloed input that the kernel row reaches, and the packed pixels of the same
                    // output rows; each kernel row, panel and piece belongs to one unit.
                    let run = unsafe {
                        PanelRun {
                            a: input
                                .as_slice()
                                .as_ptr()
                                .add(input.offset(y * spec.stride + ky + halo, halo) + first),
                            row_stride: 1,
                            depth_stride: spec.stride * pixel,
                            taps: Taps::line(lines.min(oh - y), spec.stride * row),
                            depth: ow,
                            b: packed.as_ptr().add(start * oh * ow + y * ow * width),
                            b_stride: width,
                            width,
                            out: sums_out.at(ky * rows * columns + start * rows + first * width),
                            out_stride: width,
                            rows: ROWS_IN_PIECE.min(rows - first),
                            finish: Finish::Add,
                        }
                    };
                    isa_out.run(run);
                }
            },
        );
    }
    let taps = spec.kernel * spec.kernel;
    for o in 0..spec.out_channels {
        let panel = shape.panel_of(o);
        let (start, width) = (shape.start(panel), shape.width(panel));
        for i in 0..spec.in_channels {
            for tap in 0..taps {
                let (ky, kx) = (tap / spec.kernel, tap % spec.kernel);
                grad_weight[(o * spec.in_channels + i) * taps + tap] =
                    sums[ky * rows * columns + start * rows + (kx * pixel + i) * width + o - start];
            }
        }
    }
}

/// Packs an image `[channels, pixels]` into panels `[pixel][width]`.
fn pack_pixels(isa: Isa, planes: &[f32], channels: usize, shape: PanelShape, packed: &mut [f32]) {
    const PIECE: usize = 1024;
    let pixels = planes.len() / channels;
    let out = SharedMut::new(packed);
    let pieces = pixels.div_ceil(PIECE);
    for_each(
        &mut AlignedBuffer::default(),
        0,
        shape.count() * pieces,
        |_, unit| {
            let (panel, first) = (unit / pieces, unit % pieces * PIECE);
            let (start, width) = (shape.start(panel), shape.width(panel));
            // SAFETY: pixels of the planes of this panel's channels, and their place in the panel.
            unsafe {
                isa.run(Interleave {
                    from: planes.as_ptr().wrapping_add(start * pixels + first),
                    plane: pixels,
                    channels: channels.saturating_sub(start).min(width),
                    count: PIECE.min(pixels - first),
                    to: out.at(start * pixels + first * width),
                    to_stride: width,
                    block: width,
                });
            }
        },
    );
}

/// Copies an image `[channels, height, width]` into a tensor of that shape.
fn tensor_from_planes(isa: Isa, planes: &[f32], tensor: &mut Tensor) {
    let (height, width) = (tensor.height(), tensor.width());
    let (row, pixel, channels) = (
        tensor.row_stride(),
        tensor.channel_stride(),
        tensor.channels(),
    );
    assert_eq!(
        planes.len(),
        channels * height * width,
        "elements of the image"
    );
    let out = SharedMut::new(tensor.as_mut_slice());
    for_each(&mut AlignedBuffer::default(), 0, height, |_, y| {
        // SAFETY: row `y` of every plane and of the tensor, which no other piece writes.
        unsafe {
            isa.run(Interleave {
                from: planes.as_ptr().add(y * width),
                plane: height * width,
                channels,
                count: width,
                to: out.at((y + 1) * row + pixel),
                to_stride: pixel,
                block: pixel,
            });
        }
    });
}

/// Copies a tensor into an image `[channels, height, width]`.
fn planes_from_tensor(isa: Isa, tensor: &Tensor, planes: &mut [f32]) {
    let (height, width, channels) = (tensor.height(), tensor.width(), tensor.channels());
    assert_eq!(
        planes.len(),
        channels * height * width,
        "elements of the image"
    );
    let out = SharedMut::new(planes);
    for_each(&mut AlignedBuffer::default(), 0, height, |_, y| {
        // SAFETY: row `y` of the tensor and of every plane, which no other piece writes.
        unsafe {
            isa.run(Separate {
                from: tensor.as_slice().as_ptr().add(tensor.offset(y + 1, 1)),
                from_stride: tensor.channel_stride(),
                to: out.at(y * width),
                plane: height * width,
                channels,
                count: width,
            });
        }
    });
}
