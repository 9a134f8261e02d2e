//! A [`Tensor`] as input or output of a Winograd convolution.

use std::ops::Range;

use super::blocks::{Gathered, Product};
use super::tiles::{TileSink, TileSource};
use super::transform::{TILE, WINDOW, input, output};
use crate::parallel::SharedMut;
use crate::simd::Simd;
use crate::tensor::CHANNEL_BLOCK;
use crate::{Activation, Tensor};

/// The windows of a tensor.
pub(crate) struct TensorSource<'a> {
    tensor: &'a Tensor,
    tiles_x: usize,
}

/// Number of tiles that cover an image.
pub(crate) fn tiles_of(height: usize, width: usize) -> usize {
    height.div_ceil(TILE) * width.div_ceil(TILE)
}

impl<'a> TensorSource<'a> {
    /// # Panics
    /// If the channels are not padded to whole blocks (4 channels or fewer).
    pub(crate) fn new(tensor: &'a Tensor) -> Self {
        assert!(
            tensor.channel_stride().is_multiple_of(CHANNEL_BLOCK),
            "Winograd convolution of a narrow tensor"
        );
        Self {
            tensor,
            tiles_x: tensor.width().div_ceil(TILE),
        }
    }

    pub(crate) fn tiles(&self) -> usize {
        tiles_of(self.tensor.height(), self.tensor.width())
    }
}

impl TileSource for TensorSource<'_> {
    fn scratch(&self, _tiles: usize) -> usize {
        WINDOW * WINDOW * CHANNEL_BLOCK
    }

    #[inline(always)]
    unsafe fn gather<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Gathered,
        scratch: &mut [f32],
    ) {
        let (tensor, data) = (self.tensor, self.tensor.as_slice());
        let (pixel, row) = (tensor.channel_stride(), tensor.row_stride());
        for (index, tile) in tiles.enumerate() {
            let (y, x) = (tile / self.tiles_x * TILE, tile % self.tiles_x * TILE);
            let whole = y + WINDOW <= tensor.height() + 2 && x + WINDOW <= tensor.width() + 2;
            for channel in (0..pixel).step_by(CHANNEL_BLOCK) {
                let (from, row, pixel) = if whole {
                    (&data[tensor.offset(y, x) + channel..], row, pixel)
                } else {
                    copy_clipped(tensor, y, x, channel, scratch);
                    (&*scratch, WINDOW * CHANNEL_BLOCK, CHANNEL_BLOCK)
                };
                for lane in (0..CHANNEL_BLOCK).step_by(S::LANES) {
                    let to = block.offset(index, channel + lane);
                    // SAFETY: a whole window with all channels of its last pixel starts at `from`; by the caller's contract
                    // `block` has room.
                    unsafe {
                        input(
                            simd,
                            |r, c| simd.load(from.as_ptr().add(r * row + c * pixel + lane)),
                            |point, value| {
                                simd.store(block.at(point * block.point_stride() + to), value)
                            },
                        );
                    }
                }
            }
        }
    }
}

/// Copies 16 channels of a window that reaches beyond the halo, with zeros outside.
fn copy_clipped(tensor: &Tensor, y: usize, x: usize, channel: usize, window: &mut [f32]) {
    window.fill(0.0);
    let rows = WINDOW.min(tensor.height() + 2 - y);
    let columns = WINDOW.min(tensor.width() + 2 - x);
    for r in 0..rows {
        for c in 0..columns {
            let from = tensor.offset(y + r, x + c) + channel;
            window[(r * WINDOW + c) * CHANNEL_BLOCK..][..CHANNEL_BLOCK]
                .copy_from_slice(&tensor.as_slice()[from..][..CHANNEL_BLOCK]);
        }
    }
}

/// The output tiles of a tensor, with bias and activation.
pub(crate) struct TensorSink<'a> {
    out: SharedMut,
    height: usize,
    width: usize,
    row: usize,
    pixel: usize,
    tiles_x: usize,
    /// One for each channel, padding included.
    bias: &'a [f32],
    activation: Activation,
}

impl<'a> TensorSink<'a> {
    /// # Panics
    /// If the bias is shorter than a pixel, or the channels are not padded to whole blocks.
    pub(crate) fn new(tensor: &'a mut Tensor, bias: &'a [f32], activation: Activation) -> Self {
        let (height, width, row, pixel) = (
            tensor.height(),
            tensor.width(),
            tensor.row_stride(),
            tensor.channel_stride(),
        );
        assert!(
            pixel.is_multiple_of(CHANNEL_BLOCK) && bias.len() >= pixel,
            "Winograd convolution to a narrow tensor"
        );
        let tiles_x = width.div_ceil(TILE);
        Self {
            out: SharedMut::new(tensor.as_mut_slice()),
            height,
            width,
            row,
            pixel,
            tiles_x,
            bias,
            activation,
        }
    }
}

impl TileSink for TensorSink<'_> {
    fn scratch(&self, _tiles: usize) -> usize {
        0
    }

    #[inline(always)]
    unsafe fn scatter<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Product,
        _scratch: &mut [f32],
    ) {
        let floor = match self.activation {
            Activation::Identity => simd.splat(f32::NEG_INFINITY),
            Activation::Relu => simd.zero(),
        };
        for (index, tile) in tiles.enumerate() {
            let (y, x) = (tile / self.tiles_x * TILE, tile % self.tiles_x * TILE);
            let (rows, columns) = (TILE.min(self.height - y), TILE.min(self.width - x));
            for channel in (0..self.pixel).step_by(S::LANES) {
                let from = block.offset(index, channel);
                // SAFETY: by the caller's contract `block` holds the tile; rows and columns are clipped to the tensor.
                unsafe {
                    let bias = simd.load(self.bias.as_ptr().add(channel));
                    let out = self
                        .out
                        .at((y + 1) * self.row + (x + 1) * self.pixel + channel);
                    output(
                        simd,
                        |point| simd.load(block.at(point * block.point_stride() + from)),
                        |r, c, value| {
                            if r < rows && c < columns {
                                let value = simd.max(floor, simd.add(value, bias));
                                simd.store(out.add(r * self.row + c * self.pixel), value);
                            }
                        },
                    );
                }
            }
        }
    }
}
