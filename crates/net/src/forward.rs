//! The forward pass of the network.

use grimnet_kernels::{Isa, Tensor, Workspace, max_pool_2x2, upsample_bilinear_add};
use image::{GrayImage, RgbImage};
use rayon::prelude::*;

use crate::heatmap::heatmap_from_logits;
use crate::layer::{Gathering, Kind, Layer, LayerSource};
use crate::spec::{KEYPOINT_CELL_PX, STAGES};
use crate::vlad::{VladField, VladLayer};
use crate::{Decoder, Downsample, KeypointHead, NetError, NetSpec, VladInput};

/// The layers of a network, prepared to run.
pub(crate) struct Network {
    isa: Isa,
    input: InputNorm,
    stages: Vec<(Downsample, Vec<Layer>)>,
    decoder: DecoderLayers,
    descriptor: Layer,
    keypoints: KeypointLayers,
    assign: Layer,
    vlad_input: VladInput,
}

enum DecoderLayers {
    /// On H/16, on H/32, and the fusion.
    Lateral(Box<[Layer; 3]>),
    Transposed(Box<[Layer; 2]>),
}

enum KeypointLayers {
    FromGrey { hidden: Vec<Layer>, out: Layer },
    FromDecoder(Layer),
}

/// Intermediate activations of a pass.
#[derive(Default)]
pub(crate) struct Scratch {
    workspace: Workspace,
    input: Tensor,
    ping: Tensor,
    pong: Tensor,
    stages: [Tensor; STAGES],
    logits: Tensor,
    products: Tensor,
}

/// The results of a pass.
#[derive(Default)]
pub(crate) struct Output {
    pub heatmap: Vec<f32>,
    /// At 1/8 of the resolution, not scaled to unit length.
    pub descriptors: Tensor,
    /// The vectors that NetVLAD aggregates, if these are not the descriptors.
    pub deepest: Tensor,
    pub vlad: VladField,
}

impl Network {
    pub(crate) fn new(source: &LayerSource) -> Result<Self, NetError> {
        let spec = source.model.spec();
        let stage = |(s, stage): (usize, &crate::Stage)| {
            let layer = |c: usize| {
                let stride = if c == 0 && stage.downsample == Downsample::StrideFirst {
                    2
                } else {
                    1
                };
                Layer::normalised(
                    source,
                    &format!("encoder.{s}.{c}"),
                    Kind::Conv { kernel: 3, stride },
                )
            };
            let layers = (0..stage.widths.len())
                .map(layer)
                .collect::<Result<_, NetError>>()?;
            Ok((stage.downsample, layers))
        };
        let conv = |kernel: usize| Kind::Conv { kernel, stride: 1 };
        let decoder = match spec.decoder {
            Decoder::Lateral { .. } => DecoderLayers::Lateral(Box::new([
                Layer::plain(source, "lateral.h16", conv(1))?,
                Layer::plain(source, "lateral.h32", conv(1))?,
                Layer::normalised(source, "fuse", conv(3))?,
            ])),
            Decoder::Transposed { .. } => DecoderLayers::Transposed(Box::new([
                Layer::normalised(source, "upsample.0", Kind::Transposed)?,
                Layer::normalised(source, "upsample.1", Kind::Transposed)?,
            ])),
            Decoder::TransposedPlain { .. } => DecoderLayers::Transposed(Box::new([
                Layer::plain(source, "upsample.0", Kind::Transposed)?,
                Layer::plain(source, "upsample.1", Kind::Transposed)?,
            ])),
        };
        let keypoints = match spec.keypoints {
            KeypointHead::FromGrey { layers, .. } => KeypointLayers::FromGrey {
                hidden: (0..layers)
                    .map(|i| Layer::normalised(source, &format!("keypoint.{i}"), conv(1)))
                    .collect::<Result<_, NetError>>()?,
                out: Layer::plain(source, "keypoint.out", conv(1))?,
            },
            KeypointHead::FromDecoder => {
                KeypointLayers::FromDecoder(Layer::plain(source, "keypoint", conv(3))?)
            }
        };
        Ok(Self {
            isa: source.isa,
            input: InputNorm::new(spec),
            stages: spec
                .stages
                .iter()
                .enumerate()
                .map(stage)
                .collect::<Result<_, NetError>>()?,
            decoder,
            descriptor: Layer::plain(source, "descriptor", conv(spec.descriptor_kernel()))?,
            keypoints,
            assign: Layer::product(source, "netvlad.assign")?,
            vlad_input: spec.vlad.input,
        })
    }

    /// Runs the network. Masked pixels are replaced by the mean colour, so that their values have no influence.
    pub(crate) fn run(
        &self,
        image: &RgbImage,
        mask: Option<&GrayImage>,
        vlad: &VladLayer,
        scratch: &mut Scratch,
        output: &mut Output,
        gathering: &mut Gathering,
    ) {
        let isa = self.isa;
        let Scratch {
            workspace,
            input,
            ping,
            pong,
            stages,
            logits,
            products,
        } = scratch;
        self.input.fill(image, mask, input);

        for (s, (downsample, layers)) in self.stages.iter().enumerate() {
            let (before, rest) = stages.split_at_mut(s);
            let pools = *downsample == Downsample::MaxPoolLast;
            for (c, layer) in layers.iter().enumerate() {
                let first = before.last().unwrap_or(input);
                let from = if c == 0 { first } else { &*pong };
                if c + 1 == layers.len() && !pools {
                    layer.forward(isa, from, &mut rest[0], workspace, gathering);
                } else {
                    layer.forward(isa, from, ping, workspace, gathering);
                    std::mem::swap(ping, pong);
                }
            }
            if pools {
                max_pool_2x2(isa, pong, &mut rest[0]);
            }
        }

        let [_, _, h8, h16, h32] = stages;
        self.decode([h8, h16, h32], [ping, pong], workspace, gathering);
        self.descriptor
            .forward(isa, ping, &mut output.descriptors, workspace, gathering);

        match &self.keypoints {
            KeypointLayers::FromGrey { hidden, out } => {
                grey_cells(input, ping);
                for layer in hidden {
                    layer.forward(isa, ping, pong, workspace, gathering);
                    std::mem::swap(ping, pong);
                }
                out.forward(isa, ping, logits, workspace, gathering);
            }
            KeypointLayers::FromDecoder(out) => {
                out.forward(isa, ping, logits, workspace, gathering)
            }
        }
        heatmap_from_logits(isa, logits, &mut output.heatmap);

        if self.vlad_input.is_deepest() {
            std::mem::swap(&mut output.deepest, h32);
        }
        let Output {
            descriptors,
            deepest,
            vlad: field,
            ..
        } = output;
        let vectors = if self.vlad_input.is_deepest() {
            deepest
        } else {
            descriptors
        };
        self.assign
            .forward(isa, vectors, products, workspace, gathering);
        vlad.assign(isa, vectors, products, field);
    }

    /// Computes the features at 1/8 of the resolution from the last three stages' outputs, into `ping`. `h8` is
    /// overwritten by the lateral decoder.
    fn decode(
        &self,
        [h8, h16, h32]: [&mut Tensor; 3],
        [ping, pong]: [&mut Tensor; 2],
        workspace: &mut Workspace,
        gathering: &mut Gathering,
    ) {
        let isa = self.isa;
        match &self.decoder {
            DecoderLayers::Lateral(layers) => {
                let [lateral16, lateral32, fuse] = &**layers;
                lateral16.forward(isa, h16, ping, workspace, gathering);
                lateral32.forward(isa, h32, pong, workspace, gathering);
                upsample_bilinear_add(isa, pong, ping);
                upsample_bilinear_add(isa, ping, h8);
                fuse.forward(isa, h8, ping, workspace, gathering);
            }
            DecoderLayers::Transposed(layers) => {
                let [first, second] = &**layers;
                first.forward(isa, h32, pong, workspace, gathering);
                second.forward(isa, pong, ping, workspace, gathering);
            }
        }
    }
}

impl Output {
    /// The vectors that NetVLAD aggregates.
    pub(crate) fn vlad_vectors(&self, input: VladInput) -> &Tensor {
        if input.is_deepest() {
            &self.deepest
        } else {
            &self.descriptors
        }
    }
}

/// Converts bytes to the network's input: (v / 255 - mean) / std.
struct InputNorm {
    /// For each channel and byte.
    values: [[f32; 256]; 3],
}

impl InputNorm {
    fn new(spec: &NetSpec) -> Self {
        let value =
            |c: usize, v: usize| (v as f32 / 255.0 - spec.input_mean[c]) / spec.input_std[c];
        Self {
            values: std::array::from_fn(|c| std::array::from_fn(|v| value(c, v))),
        }
    }

    /// Fills `input`. Masked pixels are 0, the mean colour.
    fn fill(&self, image: &RgbImage, mask: Option<&GrayImage>, input: &mut Tensor) {
        let (width, height) = (image.width() as usize, image.height() as usize);
        input.reshape(height, width, 3);
        let pitch = input.pixel_pitch();
        let [red, green, blue] = &self.values;
        let (pixels, _) = image.as_raw().as_chunks::<3>();
        input
            .par_rows_mut()
            .zip(pixels.par_chunks_exact(width))
            .enumerate()
            .for_each(|(y, (row, pixels))| {
                for (out, &[r, g, b]) in row.chunks_exact_mut(pitch).zip(pixels) {
                    out[..3].copy_from_slice(&[
                        red[r as usize],
                        green[g as usize],
                        blue[b as usize],
                    ]);
                }
                if let Some(mask) = mask {
                    let seen = &mask.as_raw()[y * width..][..width];
                    let unseen = row
                        .chunks_exact_mut(pitch)
                        .zip(seen)
                        .filter(|&(_, &seen)| seen == 0);
                    unseen.for_each(|(out, _)| out[..3].fill(0.0));
                }
            });
    }
}

/// The mean of the input's channels, each 8 x 8 cell as 64 channels in raster order (PyTorch's `pixel_unshuffle`).
fn grey_cells(input: &Tensor, grey: &mut Tensor) {
    const CELL: usize = KEYPOINT_CELL_PX as usize;
    grey.reshape(input.height() / CELL, input.width() / CELL, CELL * CELL);
    let (from, to) = (input.pixel_pitch(), grey.pixel_pitch());
    grey.par_rows_mut().enumerate().for_each(|(cell_y, cells)| {
        for dy in 0..CELL {
            let row = input.row(cell_y * CELL + dy);
            for (cell, pixels) in cells
                .chunks_exact_mut(to)
                .zip(row.chunks_exact(CELL * from))
            {
                for (out, pixel) in cell[dy * CELL..][..CELL]
                    .iter_mut()
                    .zip(pixels.chunks_exact(from))
                {
                    *out = (pixel[0] + pixel[1] + pixel[2]) / 3.0;
                }
            }
        }
    });
}
