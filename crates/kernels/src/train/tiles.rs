//! Winograd tiles of an NCHW batch.

use std::ops::Range;

use crate::layout::{Interleave, Separate, block_channels};
use crate::parallel::SharedMut;
use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;
use crate::winograd::transform::{TILE, WINDOW, input, output, output_gradient};
use crate::winograd::{Gathered, Product, TileSink, TileSource};

/// Tiles of a row that are turned from planes to channel blocks together.
const RUN: usize = 16;

/// How a batch is cut into tiles: image by image, row by row.
#[derive(Clone, Copy)]
pub(super) struct BatchShape {
    pub(super) batch: usize,
    pub(super) channels: usize,
    pub(super) height: usize,
    pub(super) width: usize,
}

/// Neighbouring tiles of a row.
struct Run {
    /// Row of the first within the tiles asked for.
    index: usize,
    tiles: usize,
    image: usize,
    /// Output pixel of the first tile's corner.
    y: usize,
    x: usize,
}

impl BatchShape {
    fn tiles_x(&self) -> usize {
        self.width.div_ceil(TILE)
    }

    pub(super) fn tiles(&self) -> usize {
        self.batch * self.height.div_ceil(TILE) * self.tiles_x()
    }

    fn plane(&self) -> usize {
        self.height * self.width
    }

    fn runs(self, tiles: Range<usize>) -> impl Iterator<Item = Run> {
        let (tiles_x, tiles_y) = (self.tiles_x(), self.height.div_ceil(TILE));
        let mut tile = tiles.start;
        std::iter::from_fn(move || {
            if tile >= tiles.end {
                return None;
            }
            let (line, column) = (tile / tiles_x, tile % tiles_x);
            let count = RUN.min(tiles.end - tile).min(tiles_x - column);
            let run = Run {
                index: tile - tiles.start,
                tiles: count,
                image: line / tiles_y,
                y: line % tiles_y * TILE,
                x: column * TILE,
            };
            tile += count;
            Some(run)
        })
    }

    /// Turns 16 channels of `rows x columns` pixels from `(y, x)` on into `[row][column][16]`, zero outside the image.
    ///
    /// # Safety
    /// `data` must point to a batch of this shape, `to` to room for the block.
    #[inline(always)]
    unsafe fn load_block<S: Simd>(
        &self,
        simd: S,
        data: *const f32,
        (image, channel): (usize, usize),
        (y, x): (isize, isize),
        (rows, columns): (usize, usize),
        to: *mut f32,
    ) {
        let before = (-x).max(0) as usize;
        let start = (x + before as isize) as usize;
        let count = columns
            .saturating_sub(before)
            .min(self.width.saturating_sub(start));
        for r in 0..rows {
            // SAFETY: a row of the block; the pixels read are clipped to the image.
            unsafe {
                let to = to.add(r * columns * CHANNEL_BLOCK);
                let Some(y) = usize::try_from(y + r as isize)
                    .ok()
                    .filter(|&y| y < self.height)
                else {
                    std::ptr::write_bytes(to, 0, columns * CHANNEL_BLOCK);
                    continue;
                };
                std::ptr::write_bytes(to, 0, before * CHANNEL_BLOCK);
                let after = before + count;
                std::ptr::write_bytes(
                    to.add(after * CHANNEL_BLOCK),
                    0,
                    (columns - after) * CHANNEL_BLOCK,
                );
                let from =
                    ((image * self.channels + channel) * self.height + y) * self.width + start;
                Interleave {
                    from: data.add(from),
                    plane: self.plane(),
                    channels: block_channels(self.channels, channel),
                    count,
                    to: to.add(before * CHANNEL_BLOCK),
                    to_stride: CHANNEL_BLOCK,
                    block: CHANNEL_BLOCK,
                }
                .run(simd);
            }
        }
    }
}

/// Windows of a batch.
pub(super) struct BatchSource<'a> {
    pub(super) shape: BatchShape,
    pub(super) data: &'a [f32],
}

impl TileSource for BatchSource<'_> {
    fn scratch(&self, tiles: usize) -> usize {
        WINDOW * (RUN.min(tiles) * TILE + 2) * CHANNEL_BLOCK
    }

    #[inline(always)]
    unsafe fn gather<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Gathered,
        scratch: &mut [f32],
    ) {
        let window = scratch.as_mut_ptr();
        for run in self.shape.runs(tiles) {
            let columns = run.tiles * TILE + 2;
            let corner = (run.y as isize - 1, run.x as isize - 1);
            for channel in (0..self.shape.channels).step_by(CHANNEL_BLOCK) {
                // SAFETY: the tiles exist; `scratch` was asked to hold a run; `block` has room.
                unsafe {
                    let data = self.data.as_ptr();
                    self.shape.load_block(
                        simd,
                        data,
                        (run.image, channel),
                        corner,
                        (WINDOW, columns),
                        window,
                    );
                    for tile in 0..run.tiles {
                        for lane in (0..CHANNEL_BLOCK).step_by(S::LANES) {
                            let from = window.add(tile * TILE * CHANNEL_BLOCK + lane);
                            let to = block.offset(run.index + tile, channel + lane);
                            input(
                                simd,
                                |r, c| simd.load(from.add((r * columns + c) * CHANNEL_BLOCK)),
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
}

/// Output tiles of a batch.
pub(super) struct BatchSink {
    shape: BatchShape,
    out: SharedMut,
}

impl BatchSink {
    pub(super) fn new(shape: BatchShape, out: &mut [f32]) -> Self {
        assert_eq!(
            out.len(),
            shape.batch * shape.channels * shape.plane(),
            "elements of the batch"
        );
        Self {
            shape,
            out: SharedMut::new(out),
        }
    }
}

impl TileSink for BatchSink {
    fn scratch(&self, tiles: usize) -> usize {
        TILE * RUN.min(tiles) * TILE * CHANNEL_BLOCK
    }

    #[inline(always)]
    unsafe fn scatter<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Product,
        scratch: &mut [f32],
    ) {
        let lines = scratch.as_mut_ptr();
        let shape = self.shape;
        for run in shape.runs(tiles) {
            let columns = run.tiles * TILE;
            for channel in (0..shape.channels).step_by(CHANNEL_BLOCK) {
                // SAFETY: the tiles exist and nobody else writes their outputs; `scratch` was asked to hold a run.
                unsafe {
                    for tile in 0..run.tiles {
                        for lane in (0..CHANNEL_BLOCK).step_by(S::LANES) {
                            let from = block.offset(run.index + tile, channel + lane);
                            let to = lines.add(tile * TILE * CHANNEL_BLOCK + lane);
                            output(
                                simd,
                                |point| simd.load(block.at(point * block.point_stride() + from)),
                                |r, c, value| {
                                    simd.store(to.add((r * columns + c) * CHANNEL_BLOCK), value)
                                },
                            );
                        }
                    }
                    for r in 0..TILE.min(shape.height - run.y) {
                        let to =
                            ((run.image * shape.channels + channel) * shape.height + run.y + r)
                                * shape.width;
                        Separate {
                            from: lines.add(r * columns * CHANNEL_BLOCK),
                            from_stride: CHANNEL_BLOCK,
                            to: self.out.at(to + run.x),
                            plane: shape.plane(),
                            channels: block_channels(shape.channels, channel),
                            count: columns.min(shape.width - run.x),
                        }
                        .run(simd);
                    }
                }
            }
        }
    }
}

/// Output gradients of a batch, taken back to the points.
pub(super) struct GradientSource<'a> {
    pub(super) shape: BatchShape,
    pub(super) data: &'a [f32],
}

impl GradientSource<'_> {
    pub(super) fn scratch(&self, tiles: usize) -> usize {
        TILE * RUN.min(tiles) * TILE * CHANNEL_BLOCK
    }

    /// Transforms the gradients of `tiles` into `block`, the first at row 0.
    ///
    /// # Safety
    /// The tiles must exist; `block` must have room for them and be written by nobody else meanwhile.
    #[inline(always)]
    pub(super) unsafe fn gather<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Product,
        scratch: &mut [f32],
    ) {
        let lines = scratch.as_mut_ptr();
        for run in self.shape.runs(tiles) {
            let columns = run.tiles * TILE;
            let corner = (run.y as isize, run.x as isize);
            for channel in (0..self.shape.channels).step_by(CHANNEL_BLOCK) {
                // SAFETY: the tiles exist; `scratch` was asked to hold a run; `block` has room.
                unsafe {
                    let data = self.data.as_ptr();
                    self.shape.load_block(
                        simd,
                        data,
                        (run.image, channel),
                        corner,
                        (TILE, columns),
                        lines,
                    );
                    for tile in 0..run.tiles {
                        for lane in (0..CHANNEL_BLOCK).step_by(S::LANES) {
                            let from = lines.add(tile * TILE * CHANNEL_BLOCK + lane);
                            let to = block.offset(run.index + tile, channel + lane);
                            output_gradient(
                                simd,
                                |r, c| simd.load(from.add((r * columns + c) * CHANNEL_BLOCK)),
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
}
