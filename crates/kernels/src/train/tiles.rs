//! An NHWC batch as input or output of a Winograd convolution.

use std::ops::Range;

use crate::layout::block_channels;
use crate::parallel::SharedMut;
use crate::simd::Simd;
use crate::tensor::CHANNEL_BLOCK;
use crate::winograd::transform::{TILE, WINDOW, input, output, output_gradient};
use crate::winograd::{Gathered, Product, TileSink, TileSource};

/// The shape of a batch. Its tiles are numbered image by image, row by row.
#[derive(Clone, Copy)]
pub(super) struct BatchShape {
    pub(super) batch: usize,
    pub(super) channels: usize,
    pub(super) height: usize,
    pub(super) width: usize,
}

impl BatchShape {
    /// Number of elements.
    ///
    /// # Panics
    /// If it does not fit `usize`.
    pub(super) fn len(&self) -> usize {
        let mut sides = [self.height, self.width, self.channels].into_iter();
        match sides.try_fold(self.batch, usize::checked_mul) {
            Some(len) => len,
            None => panic!("the batch does not fit the address space"),
        }
    }

    pub(super) fn tiles(&self) -> usize {
        self.batch * self.height.div_ceil(TILE) * self.width.div_ceil(TILE)
    }

    /// Image, row and column of a tile's first output.
    #[inline(always)]
    fn corner(&self, tile: usize) -> (usize, usize, usize) {
        let tiles_x = self.width.div_ceil(TILE);
        let tiles_y = self.height.div_ceil(TILE);
        let (line, column) = (tile / tiles_x, tile % tiles_x);
        (line / tiles_y, line % tiles_y * TILE, column * TILE)
    }

    #[inline(always)]
    fn offset(&self, image: usize, y: usize, x: usize, channel: usize) -> usize {
        ((image * self.height + y) * self.width + x) * self.channels + channel
    }
}

/// A square of pixels, 16 channels of each.
struct Square {
    from: *const f32,
    row_stride: usize,
    pixel_stride: usize,
}

impl Square {
    /// # Safety
    /// The pixel must lie in the square.
    #[inline(always)]
    unsafe fn at(&self, row: usize, column: usize) -> *const f32 {
        // SAFETY: the caller's contract.
        unsafe {
            self.from
                .add(row * self.row_stride + column * self.pixel_stride)
        }
    }
}

/// A batch that is read: the input of a convolution, or the gradient of its output.
#[derive(Clone, Copy)]
pub(super) struct Batch<'a> {
    shape: BatchShape,
    data: &'a [f32],
}

impl<'a> Batch<'a> {
    pub(super) fn new(shape: BatchShape, data: &'a [f32]) -> Self {
        assert_eq!(data.len(), shape.len(), "elements of the batch");
        Self { shape, data }
    }

    pub(super) fn shape(&self) -> BatchShape {
        self.shape
    }

    /// Floats of scratch that [`Batch::gather_gradients`] needs.
    pub(super) fn gradients_scratch(&self) -> usize {
        TILE * TILE * CHANNEL_BLOCK
    }

    /// Transforms the output gradients of `tiles` into `block`, the first at row 0.
    ///
    /// # Safety
    /// The tiles must exist; `scratch` must have at least [`Batch::gradients_scratch`] floats; `block` must have room for the
    /// tiles, and no other thread may read or write these rows of it.
    #[inline(always)]
    pub(super) unsafe fn gather_gradients<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Product,
        scratch: &mut [f32],
    ) {
        for (index, tile) in tiles.enumerate() {
            let (image, y, x) = self.shape.corner(tile);
            let corner = (y as isize, x as isize);
            for channel in (0..self.shape.channels).step_by(CHANNEL_BLOCK) {
                let square = self.square(image, corner, TILE, channel, scratch);
                for lane in (0..CHANNEL_BLOCK).step_by(S::LANES) {
                    let to = block.offset(index, channel + lane);
                    // SAFETY: 16 channels of each pixel of the square can be read; by the caller's contract `block` has room.
                    unsafe {
                        output_gradient(
                            simd,
                            |r, c| simd.load(square.at(r, c).add(lane)),
                            |point, value| {
                                simd.store(block.at(point * block.point_stride() + to), value)
                            },
                        );
                    }
                }
            }
        }
    }

    /// 16 channels of `side x side` pixels from `(y, x)` on: in place, or, if the square reaches beyond an edge or the last
    /// channel, a copy in `scratch` with zeros outside.
    #[inline(always)]
    fn square(
        &self,
        image: usize,
        (y, x): (isize, isize),
        side: usize,
        channel: usize,
        scratch: &mut [f32],
    ) -> Square {
        let shape = &self.shape;
        let inside = |from: isize, limit: usize| from >= 0 && from as usize + side <= limit;
        if inside(y, shape.height)
            && inside(x, shape.width)
            && channel + CHANNEL_BLOCK <= shape.channels
        {
            return Square {
                from: self.data[shape.offset(image, y as usize, x as usize, channel)..].as_ptr(),
                row_stride: shape.width * shape.channels,
                pixel_stride: shape.channels,
            };
        }
        let scratch = &mut scratch[..side * side * CHANNEL_BLOCK];
        scratch.fill(0.0);
        let channels = block_channels(shape.channels, channel);
        let clipped = |from: isize, limit: usize| {
            (0..side)
                .filter_map(move |i| Some((i, usize::try_from(from + i as isize).ok()?)))
                .filter(move |&(_, at)| at < limit)
        };
        for (r, y) in clipped(y, shape.height) {
            for (c, x) in clipped(x, shape.width) {
                let from = shape.offset(image, y, x, channel);
                scratch[(r * side + c) * CHANNEL_BLOCK..][..channels]
                    .copy_from_slice(&self.data[from..][..channels]);
            }
        }
        Square {
            from: scratch.as_ptr(),
            row_stride: side * CHANNEL_BLOCK,
            pixel_stride: CHANNEL_BLOCK,
        }
    }
}

impl TileSource for Batch<'_> {
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
        for (index, tile) in tiles.enumerate() {
            let (image, y, x) = self.shape.corner(tile);
            let corner = (y as isize - 1, x as isize - 1);
            for channel in (0..self.shape.channels).step_by(CHANNEL_BLOCK) {
                let square = self.square(image, corner, WINDOW, channel, scratch);
                for lane in (0..CHANNEL_BLOCK).step_by(S::LANES) {
                    let to = block.offset(index, channel + lane);
                    // SAFETY: 16 channels of each pixel of the square can be read; by the caller's contract `block` has room.
                    unsafe {
                        input(
                            simd,
                            |r, c| simd.load(square.at(r, c).add(lane)),
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

/// A batch that is written: the output of a convolution.
pub(super) struct BatchSink {
    shape: BatchShape,
    out: SharedMut,
}

impl BatchSink {
    pub(super) fn new(shape: BatchShape, out: &mut [f32]) -> Self {
        assert_eq!(out.len(), shape.len(), "elements of the batch");
        Self {
            shape,
            out: SharedMut::new(out),
        }
    }
}

impl TileSink for BatchSink {
    fn scratch(&self, _tiles: usize) -> usize {
        CHANNEL_BLOCK
    }

    #[inline(always)]
    unsafe fn scatter<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Product,
        scratch: &mut [f32],
    ) {
        let shape = &self.shape;
        let pixel = scratch.as_mut_ptr();
        for (index, tile) in tiles.enumerate() {
            let (image, y, x) = shape.corner(tile);
            let (rows, columns) = (TILE.min(shape.height - y), TILE.min(shape.width - x));
            for channel in (0..shape.channels).step_by(S::LANES) {
                let from = block.offset(index, channel);
                let channels = S::LANES.min(shape.channels - channel);
                // SAFETY: by the caller's contract `block` holds the tile and no other thread writes its outputs; rows,
                // columns and channels are clipped to the batch.
                unsafe {
                    let out = self.out.at(shape.offset(image, y, x, channel));
                    output(
                        simd,
                        |point| simd.load(block.at(point * block.point_stride() + from)),
                        |r, c, value| {
                            if r >= rows || c >= columns {
                                return;
                            }
                            let to = out.add((r * shape.width + c) * shape.channels);
                            if channels == S::LANES {
                                simd.store(to, value);
                            } else {
                                simd.store(pixel, value);
                                std::ptr::copy_nonoverlapping(pixel, to, channels);
                            }
                        },
                    );
                }
            }
        }
    }
}
