//! The forward pass of the network.

use grimnet_kernels::{Isa, Tensor, Workspace, max_pool_2x2, upsample_bilinear_add};
use image::{GrayImage, RgbImage};

use crate::heatmap::heatmap_from_logits;
use crate::input::{InputNorm, grey_cells};
use crate::keypoint_layers::{KeypointLayers, KeypointScratch};
use crate::layer::{Gathering, Kind, Layer, LayerSource};
use crate::spec::STAGES;
use crate::vlad::{VladField, VladLayer};
use crate::{Decoder, Downsample, NetError, VladInput};

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

/// Intermediate activations of a pass.
#[derive(Default)]
pub(crate) struct Scratch {
    workspace: Workspace,
    input: Tensor,
    ping: Tensor,
    pong: Tensor,
    stages: [Tensor; STAGES],
    keypoints: KeypointScratch,
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
            keypoints: KeypointLayers::new(source)?,
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
            keypoints,
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

        let logits = self.keypoints.logits(
            isa,
            |cells| grey_cells(input, cells),
            ping,
            keypoints,
            workspace,
            gathering,
        );
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
