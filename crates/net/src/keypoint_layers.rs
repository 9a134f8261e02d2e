//! Keypoint detection: from a picture or the decoder's features (paper, eq. 10) to the classes of each cell.

use grimnet_kernels::{Isa, Tensor, Workspace};

use crate::layer::{Gathering, Kind, Layer, LayerSource};
use crate::{KeypointHead, NetError};

/// The layers that detect keypoints.
pub(crate) enum KeypointLayers {
    FromGrey { hidden: Vec<Layer>, out: Layer },
    FromDecoder(Layer),
}

/// Intermediate activations of keypoint detection.
#[derive(Default)]
pub(crate) struct KeypointScratch {
    ping: Tensor,
    pong: Tensor,
    logits: Tensor,
}

impl KeypointLayers {
    pub(crate) fn new(source: &LayerSource) -> Result<Self, NetError> {
        let conv = |kernel: usize| Kind::Conv { kernel, stride: 1 };
        Ok(match source.model.spec().keypoints {
            KeypointHead::FromGrey { layers, .. } => Self::FromGrey {
                hidden: (0..layers)
                    .map(|i| Layer::normalised(source, &format!("keypoint.{i}"), conv(1)))
                    .collect::<Result<_, NetError>>()?,
                out: Layer::plain(source, "keypoint.out", conv(1))?,
            },
            KeypointHead::FromDecoder => {
                Self::FromDecoder(Layer::plain(source, "keypoint", conv(3))?)
            }
        })
    }

    /// The logits of each cell's classes, in `scratch`. `grey_cells` writes the cells of the picture that a head needs which looks at
    /// the picture; `decoded` are the decoder's features, which the other one needs.
    pub(crate) fn logits<'s>(
        &self,
        isa: Isa,
        grey_cells: impl FnOnce(&mut Tensor),
        decoded: &Tensor,
        scratch: &'s mut KeypointScratch,
        workspace: &mut Workspace,
        gathering: &mut Gathering,
    ) -> &'s Tensor {
        let KeypointScratch { ping, pong, logits } = scratch;
        match self {
            Self::FromGrey { hidden, out } => {
                grey_cells(ping);
                for layer in hidden {
                    layer.forward(isa, ping, pong, workspace, gathering);
                    std::mem::swap(ping, pong);
                }
                out.forward(isa, ping, logits, workspace, gathering);
            }
            Self::FromDecoder(out) => out.forward(isa, decoded, logits, workspace, gathering),
        }
        logits
    }
}
