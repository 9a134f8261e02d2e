//! A decoded picture.

use image::RgbImage;

use crate::colour::{ColourDescription, Planes, rgb_from_planes};
use crate::error::Fault;

/// Samples of a decoded picture, as the decoder gives them.
pub(crate) enum Picture {
    /// Eight bits, cropped at the right and at the bottom.
    H264 {
        /// Columns at the left and rows at the top that are not shown.
        hidden_px: (usize, usize),
        width: usize,
        height: usize,
        luma: Vec<u8>,
        blue: Vec<u8>,
        red: Vec<u8>,
    },
    /// Eight or ten bits.
    H265(rusty_h265::Frame),
}

impl Picture {
    /// The part that is shown, as RGB.
    pub(crate) fn to_rgb<'a>(&'a self, colour: ColourDescription) -> Result<RgbImage, Fault> {
        match self {
            &Self::H264 {
                hidden_px: (left, top),
                width,
                height,
                ref luma,
                ref blue,
                ref red,
            } => {
                let chroma_stride = width.div_ceil(2);
                let shown = |plane: &'a [u8], start: usize| plane.get(start..).unwrap_or_default();
                let chroma_start = top / 2 * chroma_stride + left / 2;
                rgb_from_planes(
                    &Planes {
                        width: width.saturating_sub(left),
                        height: height.saturating_sub(top),
                        luma: shown(luma, top * width + left),
                        luma_stride: width,
                        blue: shown(blue, chroma_start),
                        red: shown(red, chroma_start),
                        chroma_stride,
                        luma_bits: 8,
                        chroma_bits: 8,
                    },
                    colour,
                )
            }
            Self::H265(frame) => {
                let picture = &frame.picture;
                let (left, top, width, height) = picture.crop;
                let shown = |plane: usize, left: usize, top: usize| {
                    let plane = &picture.planes[plane];
                    let start = top * plane.stride + left;
                    (plane.data.get(start..).unwrap_or_default(), plane.stride)
                };
                let (luma, luma_stride) = shown(0, left, top);
                let (blue, chroma_stride) = shown(1, left / 2, top / 2);
                let (red, _) = shown(2, left / 2, top / 2);
                rgb_from_planes(
                    &Planes {
                        width,
                        height,
                        luma,
                        luma_stride,
                        blue,
                        red,
                        chroma_stride,
                        luma_bits: picture.bit_depth_luma,
                        chroma_bits: picture.bit_depth_chroma,
                    },
                    colour,
                )
            }
        }
    }
}
