//! The network's description: presets and layer shapes.

use serde::{Deserialize, Serialize};

/// The sides of an image must be multiples of this: the network halves it five times.
pub const SIZE_MULTIPLE_PX: u32 = 32;
/// Side of a keypoint cell and pitch of the local descriptors, pixels of the image.
pub const KEYPOINT_CELL_PX: u32 = 8;
/// Keypoint classes of a cell: its 64 pixels in raster order, then "none" (SuperPoint, DeTone et al. 2018).
pub const KEYPOINT_CLASSES: usize = 65;
/// Added to the variance in every normalisation (paper, eq. 3).
pub const BATCH_NORM_EPSILON: f32 = 1e-5;
/// Number of stages; the last works at 1/32 of the image's side.
pub(crate) const STAGES: usize = 5;

/// Which of the two sets of DA-BN statistics and affine parameters is used (paper, section 3.3.2, eq. 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Maps: satellite images and orthophotos.
    Sat,
    /// Photos taken by a drone.
    Uav,
}

impl Domain {
    /// Both domains, in the order in which they are stored.
    pub const ALL: [Domain; 2] = [Domain::Sat, Domain::Uav];

    /// The name used in tensor names: `sat` or `uav`.
    pub fn name(self) -> &'static str {
        match self {
            Domain::Sat => "sat",
            Domain::Uav => "uav",
        }
    }

    /// The name of a tensor of a layer's normalisation; `part` is `weight`, `bias`, `mean` or `var`.
    pub fn norm_name(self, layer: &str, part: &str) -> String {
        format!("{layer}.norm.{}.{part}", self.name())
    }

    /// Layer and part of a tensor of this domain's normalisation: the inverse of [`Self::norm_name`]. `None` for other
    /// tensors.
    pub fn norm_of(self, tensor: &str) -> Option<(&str, &str)> {
        let (layer, rest) = tensor.split_once(".norm.")?;
        let part = rest.strip_prefix(self.name())?.strip_prefix('.')?;
        Some((layer, part))
    }
}

/// How a stage halves the resolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Downsample {
    /// The first convolution has stride 2.
    StrideFirst,
    /// 2 x 2 max pooling after the last convolution (VGG).
    MaxPoolLast,
}

/// One stage of the encoder: 3 x 3 convolutions, each with DA-BN and ReLU, which together halve the resolution once.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stage {
    /// Output channels of each convolution.
    pub widths: Vec<usize>,
    /// How the stage halves the resolution.
    pub downsample: Downsample,
}

/// How features at 1/8 of the resolution are computed from the stages' outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decoder {
    /// `compact`: H/16 and H/32 go through 1 x 1 convolutions to `width` channels, are bilinearly upsampled and added to H/8
    /// (whose width must be `width`); a 3 x 3 convolution with DA-BN and ReLU fuses, a 1 x 1 convolution gives descriptors.
    Lateral {
        /// Channels of the fused features.
        width: usize,
    },
    /// Two 4 x 4 transposed convolutions, stride 2, padding 1, from H/32 to H/8 (paper, eq. 4), each followed by DA-BN and
    /// ReLU, which the paper does not have; a 3 x 3 convolution gives descriptors.
    Transposed {
        /// Output channels of both transposed convolutions.
        width: usize,
    },
    /// As [`Decoder::Transposed`], but as published (eq. 4): the transposed convolutions have a bias and neither normalisation
    /// nor activation.
    TransposedPlain {
        /// Output channels of both transposed convolutions.
        width: usize,
    },
}

impl Decoder {
    /// Channels of the features at 1/8 of the resolution.
    pub fn width(self) -> usize {
        match self {
            Decoder::Lateral { width }
            | Decoder::Transposed { width }
            | Decoder::TransposedPlain { width } => width,
        }
    }
}

/// From what keypoints are detected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KeypointHead {
    /// From the image itself: the channel mean of the normalised input, each 8 x 8 cell rearranged to 64 channels, then
    /// `layers` 1 x 1 convolutions of `width` channels with DA-BN and ReLU, then 1 x 1 to 65 classes.
    FromGrey {
        /// Channels of the hidden layers.
        width: usize,
        /// Number of hidden layers.
        layers: usize,
    },
    /// From the decoder's features, by a 3 x 3 convolution to 65 classes (as in the paper).
    FromDecoder,
}

/// The vectors that NetVLAD aggregates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VladInput {
    /// The encoder's last output, at 1/32 of the resolution, scaled to unit length at each position.
    Deepest,
    /// The encoder's last output, at 1/32 of the resolution, not scaled (paper, eq. 5-6).
    DeepestUnscaled,
    /// The local descriptors, at 1/8 of the resolution, scaled to unit length at each position.
    Descriptors,
}

impl VladInput {
    /// Whether the encoder's last output is aggregated.
    pub fn is_deepest(self) -> bool {
        self != Self::Descriptors
    }

    /// Whether vectors are scaled to unit length before they are assigned.
    pub fn is_scaled(self) -> bool {
        self != Self::DeepestUnscaled
    }
}

/// The NetVLAD layer (paper, eq. 5-7; Arandjelovic et al. 2016).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Vlad {
    /// The vectors that it aggregates.
    pub input: VladInput,
    /// Number of clusters K.
    pub clusters: usize,
}

/// The description of a network, stored in the model file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NetSpec {
    /// Name of the preset, or of the preset from which this variant was derived.
    pub preset: String,
    /// Mean of red, green and blue (each 0 to 1), subtracted from the input.
    pub input_mean: [f32; 3],
    /// Standard deviation of red, green and blue, by which the difference is divided.
    pub input_std: [f32; 3],
    /// The encoder: five stages.
    pub stages: Vec<Stage>,
    /// How features at 1/8 of the resolution are computed.
    pub decoder: Decoder,
    /// Length D of a local descriptor.
    pub descriptor_dim: usize,
    /// From what keypoints are detected.
    pub keypoints: KeypointHead,
    /// The aggregation of the global descriptor.
    pub vlad: Vlad,
    /// Length of the global descriptor after PCA whitening (eq. 8); 0 for no whitening, the descriptor then has K x D values.
    pub global_dim: usize,
}

impl NetSpec {
    /// The default network: narrow early stages, lateral decoder, keypoints from the grey image, NetVLAD on the local
    /// descriptors.
    pub fn compact() -> Self {
        let stage = |width: usize| Stage {
            widths: vec![width, width],
            downsample: Downsample::StrideFirst,
        };
        Self {
            preset: "compact".into(),
            input_mean: [0.45; 3],
            input_std: [0.25; 3],
            stages: [16, 48, 128, 128, 128].map(stage).into(),
            decoder: Decoder::Lateral { width: 128 },
            descriptor_dim: 128,
            keypoints: KeypointHead::FromGrey {
                width: 64,
                layers: 3,
            },
            vlad: Vlad {
                input: VladInput::Descriptors,
                clusters: 64,
            },
            global_dim: 1024,
        }
    }

    /// The paper's encoder, VGG-16 (Simonyan and Zisserman 2015) conv1 to conv5, two transposed convolutions, each followed by
    /// normalisation and ReLU, NetVLAD on the deepest features, scaled to unit length, with whitening from 32,768 to 512 values. The
    /// input is normalised with ImageNet's statistics. [`NetSpec::vgg16_paper`] has the layers as published.
    pub fn vgg16() -> Self {
        let stage = |&(width, layers): &(usize, usize)| Stage {
            widths: vec![width; layers],
            downsample: Downsample::MaxPoolLast,
        };
        Self {
            preset: "vgg16".into(),
            input_mean: [0.485, 0.456, 0.406],
            input_std: [0.229, 0.224, 0.225],
            stages: [(64, 2), (128, 2), (256, 3), (512, 3), (512, 3)]
                .iter()
                .map(stage)
                .collect(),
            decoder: Decoder::Transposed { width: 512 },
            descriptor_dim: 256,
            keypoints: KeypointHead::FromDecoder,
            vlad: Vlad {
                input: VladInput::Deepest,
                clusters: 64,
            },
            global_dim: 512,
        }
    }

    /// The paper's layers as published: as [`NetSpec::vgg16`] without normalisation and activation after the transposed
    /// convolutions (eq. 4), and without scaling of NetVLAD's input (eq. 5-6). It is harder to train from random weights.
    pub fn vgg16_paper() -> Self {
        let normalised = Self::vgg16();
        Self {
            preset: "vgg16-paper".into(),
            decoder: Decoder::TransposedPlain { width: 512 },
            vlad: Vlad {
                input: VladInput::DeepestUnscaled,
                ..normalised.vlad
            },
            ..normalised
        }
    }

    /// The paper's encoder with `compact`'s lateral decoder and NetVLAD on the local descriptors: fine detail does not have to
    /// pass through the deepest stage, so that it can be trained without weights from ImageNet.
    pub fn vgg16_lateral() -> Self {
        let paper = Self::vgg16();
        Self {
            preset: "vgg16-lateral".into(),
            decoder: Decoder::Lateral { width: 256 },
            vlad: Vlad {
                input: VladInput::Descriptors,
                ..paper.vlad
            },
            ..paper
        }
    }

    /// All presets, the default first.
    pub fn presets() -> [Self; 4] {
        [
            Self::compact(),
            Self::vgg16(),
            Self::vgg16_lateral(),
            Self::vgg16_paper(),
        ]
    }

    /// The preset of that name; `None` if there is none.
    pub fn preset(name: &str) -> Option<Self> {
        Self::presets().into_iter().find(|spec| spec.preset == name)
    }

    /// Channels of the encoder's output after stage `index` (0 to 4), at 1/2^(index+1) of the resolution; 0 for other stages.
    pub fn stage_width(&self, index: usize) -> usize {
        self.stages
            .get(index)
            .and_then(|stage| stage.widths.last())
            .copied()
            .unwrap_or(0)
    }

    /// Values of the encoder's largest activation per pixel of the input, at least 1: memory is proportional to it.
    pub fn widest_per_pixel(&self) -> usize {
        let values = |(halved, stage): (usize, &Stage)| {
            let halved = match stage.downsample {
                Downsample::StrideFirst => halved + 1,
                Downsample::MaxPoolLast => halved,
            };
            let width = stage.widths.iter().copied().max().unwrap_or(0);
            // A quarter of the pixels after each halving of the sides.
            width >> (2 * halved)
        };
        let stages = self.stages.iter().take(STAGES).enumerate();
        stages.map(values).max().unwrap_or(1).max(1)
    }

    /// Length D of the vectors that NetVLAD aggregates.
    pub fn vlad_dim(&self) -> usize {
        match self.vlad.input {
            VladInput::Deepest | VladInput::DeepestUnscaled => self.stage_width(STAGES - 1),
            VladInput::Descriptors => self.descriptor_dim,
        }
    }

    /// Pitch of the vectors that NetVLAD aggregates: 32 or 8 px.
    pub fn vlad_pitch_px(&self) -> u32 {
        match self.vlad.input {
            VladInput::Deepest | VladInput::DeepestUnscaled => SIZE_MULTIPLE_PX,
            VladInput::Descriptors => KEYPOINT_CELL_PX,
        }
    }

    /// Length K x D of a VLAD vector before whitening.
    pub fn vlad_len(&self) -> usize {
        self.vlad.clusters * self.vlad_dim()
    }

    /// Whether the global descriptor is whitened.
    pub fn has_whitening(&self) -> bool {
        self.global_dim != 0 && self.global_dim != self.vlad_len()
    }

    /// Length of the global descriptor.
    pub fn global_len(&self) -> usize {
        if self.has_whitening() {
            self.global_dim
        } else {
            self.vlad_len()
        }
    }

    /// Side of the kernel of the convolution that computes descriptors (3 in the paper, eq. 14).
    pub(crate) fn descriptor_kernel(&self) -> usize {
        match self.decoder {
            Decoder::Lateral { .. } => 1,
            Decoder::Transposed { .. } | Decoder::TransposedPlain { .. } => 3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_and_have_the_published_sizes() {
        for spec in NetSpec::presets() {
            spec.validate().unwrap();
            assert_eq!(NetSpec::preset(&spec.preset).as_ref(), Some(&spec));
        }
        let widest = NetSpec::presets().map(|spec| spec.widest_per_pixel());
        assert_eq!(widest, [4, 64, 64, 64]);
        let mut later = NetSpec::compact();
        later.stages[1].widths = vec![8, 512];
        assert_eq!(later.widest_per_pixel(), 32);
        let lengths = NetSpec::presets().map(|spec| spec.global_len());
        assert_eq!(lengths, [1024, 512, 512, 512]);
        // VGG-16's 13 convolutions hold 14,710,464 weights without biases.
        let encoder = |(name, shape): &(String, Vec<usize>)| {
            (name.starts_with("encoder") && shape.len() == 4)
                .then(|| shape.iter().product::<usize>())
        };
        assert_eq!(
            NetSpec::vgg16()
                .parameters()
                .iter()
                .filter_map(encoder)
                .sum::<usize>(),
            14_710_464
        );
        assert_eq!(NetSpec::vgg16().vlad_len(), 32_768);
    }

    #[test]
    fn descriptions_survive_json() {
        for spec in NetSpec::presets() {
            let text = serde_json::to_string(&spec).unwrap();
            assert_eq!(serde_json::from_str::<NetSpec>(&text).unwrap(), spec);
        }
    }
}
