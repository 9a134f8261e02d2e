//! The forward pass with activations and weights of bytes ([`crate::Precision::Int8`]).
//!
//! Keypoints come from the picture in single precision, and are those of the ordinary network. Descriptors and the products of NetVLAD's
//! assignment are floats again.

use grimnet_kernels::{
    ByteScale, ByteTensor, ConvSpec, Isa, MatMut, MatRef, QuantisedConv2d, QuantisedWeights,
    Tensor, UpsampledSum, Workspace, matmul_nn, upsample_add_exact,
};
use image::{GrayImage, RgbImage};

use crate::NetError;
use crate::activation_range::{rectified, sum_of_rectified};
use crate::forward::Output;
use crate::heatmap::heatmap_from_logits;
use crate::input::{InputNorm, fill_bytes, picture_scale};
use crate::keypoint_layers::{KeypointLayers, KeypointScratch};
use crate::layer::{Gathering, Kind, LayerSource, shape};
use crate::spec::STAGES;
use crate::vlad::VladLayer;

/// Stages whose outputs the decoder reads: at 1/8, 1/16 and 1/32 of the resolution.
const DECODED: [usize; 3] = [2, 3, 4];

/// The layers of a network of the form of `compact`, prepared to run.
pub(crate) struct ByteNetwork {
    isa: Isa,
    input: InputNorm,
    /// The bytes of the mean colour.
    zero: [u8; 3],
    stages: Vec<Vec<QuantisedConv2d>>,
    /// On H/16 and on H/32.
    laterals: [QuantisedConv2d; 2],
    sum: UpsampledSum,
    fuse: QuantisedConv2d,
    descriptor: QuantisedConv2d,
    /// The products of NetVLAD's assignment with the descriptors.
    assign: QuantisedConv2d,
    keypoints: KeypointLayers,
}

/// Intermediate activations of a pass.
#[derive(Default)]
pub(crate) struct ByteScratch {
    workspace: Workspace,
    picture: ByteTensor,
    ping: ByteTensor,
    pong: ByteTensor,
    stages: [ByteTensor; STAGES],
    laterals: [Tensor; 2],
    keypoints: KeypointScratch,
    products: Tensor,
}

impl ByteNetwork {
    /// For a network that [`crate::Precision::supports`].
    pub(crate) fn new(source: &LayerSource) -> Result<Self, NetError> {
        let spec = source.model.spec();
        let picture = picture_scale(spec);
        let zero = picture.zero_bytes();
        let mut scale = picture;
        let (mut stages, mut decoded) = (Vec::new(), Vec::new());
        for (s, stage) in spec.stages.iter().enumerate() {
            let mut layers = Vec::new();
            for c in 0..stage.widths.len() {
                let name = format!("encoder.{s}.{c}");
                let kind = Kind::Conv {
                    kernel: 3,
                    stride: if c == 0 { 2 } else { 1 },
                };
                let of_picture = s == 0 && c == 0;
                let output = rectified(source, &name)?;
                layers.push(normalised(
                    source, &name, kind, &scale, &output, of_picture,
                )?);
                scale = output;
            }
            stages.push(layers);
            if DECODED.contains(&s) {
                decoded.push((
                    format!("encoder.{s}.{}", stage.widths.len() - 1),
                    scale.clone(),
                ));
            }
        }
        let [(h8, h8_scale), (h16, h16_scale), (h32, h32_scale)] = &decoded[..] else {
            unreachable!("there are as many as in `DECODED`: a network has five stages");
        };
        let sum_scale = sum_of_rectified(source, h8, [("lateral.h16", h16), ("lateral.h32", h32)])?;
        let fused = rectified(source, "fuse")?;
        let conv = Kind::Conv {
            kernel: 3,
            stride: 1,
        };
        Ok(Self {
            isa: source.isa,
            input: InputNorm::new(spec),
            zero: std::array::from_fn(|i| zero[i]),
            stages,
            laterals: [
                plain(source, "lateral.h16", h16_scale)?,
                plain(source, "lateral.h32", h32_scale)?,
            ],
            sum: UpsampledSum::new(h8_scale, &sum_scale),
            fuse: normalised(source, "fuse", conv, &sum_scale, &fused, false)?,
            descriptor: plain(source, "descriptor", &fused)?,
            assign: assignment(source, &fused)?,
            keypoints: KeypointLayers::new(source)?,
        })
    }

    /// Runs the network. Masked pixels are replaced by the mean colour, so that their values have no influence.
    pub(crate) fn run(
        &self,
        image: &RgbImage,
        mask: Option<&GrayImage>,
        vlad: &VladLayer,
        scratch: &mut ByteScratch,
        output: &mut Output,
    ) {
        let isa = self.isa;
        let ByteScratch {
            workspace,
            picture,
            ping,
            pong,
            stages,
            laterals: [h16, h32],
            keypoints,
            products,
        } = scratch;
        let gathering = &mut Gathering::default();
        fill_bytes(image, mask, self.zero, picture);
        for (s, layers) in self.stages.iter().enumerate() {
            let (before, rest) = stages.split_at_mut(s);
            for (c, layer) in layers.iter().enumerate() {
                let first = before.last().unwrap_or(picture);
                let from = if c == 0 { first } else { &*pong };
                if c + 1 == layers.len() {
                    layer.forward_relu(from, &mut rest[0]);
                } else {
                    layer.forward_relu(from, ping);
                    std::mem::swap(ping, pong);
                }
            }
        }
        for (layer, (stage, to)) in self
            .laterals
            .iter()
            .zip([(DECODED[1], &mut *h16), (DECODED[2], &mut *h32)])
        {
            layer.forward(&stages[stage], to);
        }
        upsample_add_exact(isa, h32, h16);
        self.sum.run(isa, &stages[DECODED[0]], h16, ping);
        self.fuse.forward_relu(ping, pong);
        self.descriptor.forward(pong, &mut output.descriptors);
        self.assign.forward(pong, products);

        let logits = self.keypoints.logits(
            isa,
            |cells| self.input.fill_grey_cells(image, mask, cells),
            h16,
            keypoints,
            workspace,
            gathering,
        );
        heatmap_from_logits(isa, logits, &mut output.heatmap);
        vlad.assign(isa, &output.descriptors, products, &mut output.vlad);
    }
}

/// Convolution, DA-BN, ReLU.
fn normalised(
    source: &LayerSource,
    name: &str,
    kind: Kind,
    input: &ByteScale,
    output: &ByteScale,
    of_picture: bool,
) -> Result<QuantisedConv2d, NetError> {
    let (kernel, shift) = source.folded(name, kind)?;
    let spec = conv_spec(source, name, kind)?;
    let weights = QuantisedWeights::new(spec, &kernel, &shift, input)?;
    let factors: Vec<f32> = weights
        .unit
        .iter()
        .zip(&output.scale)
        .map(|(unit, scale)| unit / scale)
        .collect();
    let new = if of_picture {
        QuantisedConv2d::of_picture
    } else {
        QuantisedConv2d::new
    };
    Ok(new(source.isa, spec, &weights, &factors)?)
}

/// A convolution of 1 x 1 and bias only, from bytes to floats.
fn plain(source: &LayerSource, name: &str, input: &ByteScale) -> Result<QuantisedConv2d, NetError> {
    let part = |part: &str| source.model.values(&format!("{name}.{part}"));
    to_floats(source.isa, &part("weight")?, &part("bias")?, input)
}

/// The products of NetVLAD's assignment with the descriptors, straight from what these are computed from: a product of two matrices is
/// one.
fn assignment(source: &LayerSource, input: &ByteScale) -> Result<QuantisedConv2d, NetError> {
    let values = |name: &str| source.model.values(name);
    let (descriptor, bias) = (values("descriptor.weight")?, values("descriptor.bias")?);
    let assign = values("netvlad.assign.weight")?;
    let (clusters, dim) = (source.model.spec().vlad.clusters, bias.len());
    let in_channels = input.scale.len();
    let mut weights = vec![0.0f32; clusters * in_channels];
    matmul_nn(
        // The same weights whatever the instruction set.
        Isa::Portable,
        MatRef::new(&assign, clusters, dim),
        MatRef::new(&descriptor, dim, in_channels),
        MatMut::new(&mut weights, clusters, in_channels),
    );
    let dot = |row: &[f32]| row.iter().zip(&bias).map(|(w, b)| w * b).sum::<f32>();
    let biases: Vec<f32> = assign.chunks_exact(dim).map(dot).collect();
    to_floats(source.isa, &weights, &biases, input)
}

/// A 1 x 1 convolution from bytes to floats: `weights` has a row of input channels for each element of `bias`.
fn to_floats(
    isa: Isa,
    weights: &[f32],
    bias: &[f32],
    input: &ByteScale,
) -> Result<QuantisedConv2d, NetError> {
    let spec = ConvSpec {
        in_channels: input.scale.len(),
        out_channels: bias.len(),
        kernel: 1,
        stride: 1,
    };
    let weights = QuantisedWeights::new(spec, weights, bias, input)?;
    Ok(QuantisedConv2d::new(isa, spec, &weights, &weights.unit)?)
}

fn conv_spec(source: &LayerSource, name: &str, kind: Kind) -> Result<ConvSpec, NetError> {
    let [out_channels, in_channels, kernel, _] = shape(source.model, name)?;
    let stride = match kind {
        Kind::Conv { stride, .. } => stride,
        Kind::Transposed => 1,
    };
    Ok(ConvSpec {
        in_channels,
        out_channels,
        kernel,
        stride,
    })
}
