//! Gradient of a 3x3 kernel in the Winograd domain.
//!
//! Forward is `y = A^T [sum over channels (G g G^T) * (B^T d B)] A`, so the gradient of a kernel is
//! `G^T [sum over tiles (A dy A^T) * (B^T d B)] G`: at each point a product of channels by output channels whose depth is
//! the tiles of the whole batch.

use std::ops::Range;

use super::tiles::Batch;
use crate::buffer::AlignedBuffer;
use crate::layout::block_channels;
use crate::panel::{Finish, LeftRows, OutputRows, PanelProduct, PanelShape, RightPanel, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;
use crate::winograd::transform::{POINTS, weight_gradient};
use crate::winograd::{Gathered, Product, TileSource, padded_stride};
use crate::{Isa, Workspace};

/// Size of both operands of the products, which should stay in the last-level cache.
const SHARED_BYTES: usize = 16 << 20;
/// Fewest tiles in a chunk: the sums are read and written once for each chunk.
const FEWEST_TILES: usize = 96;
/// Tiles that one task transforms.
const PIECE: usize = 16;

/// `grad_weight[out, in, 3, 3]` from the input and the gradient of the output, summed over the batch.
pub(super) fn grad_weight(
    isa: Isa,
    x: &Batch<'_>,
    grad_y: &Batch<'_>,
    grad_weight: &mut [f32],
    points: &mut AlignedBuffer,
    workspace: &mut Workspace,
) {
    let (inputs, outputs) = (x.shape().channels, grad_y.shape().channels);
    let depth = inputs.next_multiple_of(CHANNEL_BLOCK);
    let shape = PanelShape::new(isa, outputs.next_multiple_of(CHANNEL_BLOCK));
    let tiles = x.shape().tiles();
    let bytes_of_tile = POINTS * (depth + shape.columns()) * size_of::<f32>();
    let capacity = (SHARED_BYTES / bytes_of_tile).max(FEWEST_TILES).min(tiles);

    let Workspace {
        shared,
        workers: scratch,
    } = workspace;
    let (windows_floats, gradients_floats) = (
        Gathered::floats_for(capacity, depth),
        Product::floats_for(capacity, shape),
    );
    let (windows, gradients) = shared
        .floats(windows_floats + gradients_floats)
        .split_at_mut(windows_floats);
    let (windows, gradients) = (
        Gathered::new(windows, capacity, depth),
        Product::new(gradients, capacity, shape),
    );
    let sums = Sums {
        depth,
        shape,
        memory: SharedMut::new(points.floats(Sums::floats(depth, shape))),
    };

    for first in (0..tiles).step_by(capacity) {
        let chunk = first..tiles.min(first + capacity);
        gather(isa, x, grad_y, &chunk, windows, gradients, scratch);
        multiply(isa, chunk, windows, gradients, sums, scratch);
    }
    finalise(isa, sums, [inputs, outputs], grad_weight, scratch);
}

/// Transforms the windows and the output gradients of a chunk of tiles.
fn gather(
    isa: Isa,
    x: &Batch<'_>,
    grad_y: &Batch<'_>,
    chunk: &Range<usize>,
    windows: Gathered,
    gradients: Product,
    scratch: &mut AlignedBuffer,
) {
    let count = chunk.len();
    let pieces = count.div_ceil(PIECE);
    let scratch_floats = x.scratch(PIECE).max(grad_y.gradients_scratch());
    for_each(scratch, scratch_floats, 2 * pieces, |scratch, task| {
        let rows = task / 2 * PIECE..(task / 2 * PIECE + PIECE).min(count);
        let tiles = chunk.start + rows.start..chunk.start + rows.end;
        if task % 2 == 0 {
            let block = windows.starting_at(rows.start);
            // SAFETY: the tiles exist; the block has room for them, and these rows belong to this task.
            isa.run(unsafe { GatherWindows::new(x, tiles, block, scratch) });
        } else {
            let block = gradients.starting_at(rows.start);
            // SAFETY: as above.
            isa.run(unsafe { GatherGradients::new(grad_y, tiles, block, scratch) });
        }
    });
}

/// Adds the products of a chunk of tiles to the sums; the first chunk overwrites them.
fn multiply(
    isa: Isa,
    chunk: Range<usize>,
    windows: Gathered,
    gradients: Product,
    sums: Sums,
    scratch: &mut AlignedBuffer,
) {
    let Sums { depth, shape, .. } = sums;
    let (first, count) = (chunk.start, chunk.len());
    for_each(scratch, 0, POINTS * shape.count(), |_, task| {
        let (point, panel) = (task / shape.count(), task % shape.count());
        let width = shape.width(panel);
        let finish = if first == 0 {
            Finish::Store
        } else {
            Finish::Add
        };
        for channel in (0..depth).step_by(CHANNEL_BLOCK) {
            // SAFETY: inside the blocks, whose first `count` rows are filled; the sums of this point and panel belong to
            // this task.
            let run = unsafe {
                let left = LeftRows {
                    start: windows.at(point * windows.point_stride() + windows.offset(0, channel)),
                    rows: CHANNEL_BLOCK,
                    row_stride: 1,
                    taps: Taps::ONE,
                    depth: count,
                    depth_stride: CHANNEL_BLOCK,
                };
                let right = RightPanel {
                    start: gradients
                        .at(point * gradients.point_stride()
                            + gradients.offset(0, shape.start(panel))),
                    row_stride: width,
                    width,
                };
                let to = OutputRows {
                    start: sums.at(point, panel, channel),
                    row_stride: width,
                };
                PanelProduct::new(left, right, to, finish)
            };
            isa.run(run);
        }
    });
}

/// Transforms the sums back to the gradient of the kernels, `[outputs][inputs][3][3]`.
fn finalise(
    isa: Isa,
    sums: Sums,
    [inputs, outputs]: [usize; 2],
    grad_weight: &mut [f32],
    scratch: &mut AlignedBuffer,
) {
    let Sums { depth, shape, .. } = sums;
    let blocks = depth / CHANNEL_BLOCK;
    let out = SharedMut::new(grad_weight);
    for_each(
        scratch,
        9 * CHANNEL_BLOCK * shape.width(0),
        shape.count() * blocks,
        |taps, task| {
            let (panel, channel) = (task / blocks, task % blocks * CHANNEL_BLOCK);
            let (start, width) = (shape.start(panel), shape.width(panel));
            // SAFETY: panel and channels exist, and the sums are complete.
            isa.run(unsafe { Finalise::new(sums, panel, channel, taps) });
            let channels = block_channels(inputs, channel);
            for j in 0..width.min(outputs.saturating_sub(start)) {
                // SAFETY: the kernels of one output channel and up to 16 input channels, which belong to this task.
                let line = unsafe {
                    std::slice::from_raw_parts_mut(
                        out.at(((start + j) * inputs + channel) * 9),
                        channels * 9,
                    )
                };
                for (tap, value) in line.iter_mut().enumerate() {
                    *value = taps[tap * width + j];
                }
            }
        },
    );
}

/// Gradients at the points: `[point][panel][in][width]`.
#[derive(Clone, Copy)]
struct Sums {
    depth: usize,
    shape: PanelShape,
    memory: SharedMut,
}

impl Sums {
    fn point_stride(depth: usize, shape: PanelShape) -> usize {
        padded_stride(depth * shape.columns())
    }

    fn floats(depth: usize, shape: PanelShape) -> usize {
        POINTS * Self::point_stride(depth, shape)
    }

    /// # Safety
    /// Point, panel and channel must exist.
    #[inline(always)]
    unsafe fn at(&self, point: usize, panel: usize, channel: usize) -> *mut f32 {
        let in_point = self.shape.start(panel) * self.depth + channel * self.shape.width(panel);
        // SAFETY: the caller's contract.
        unsafe {
            self.memory
                .at(point * Self::point_stride(self.depth, self.shape) + in_point)
        }
    }
}

/// Transforms the windows of a run of tiles.
struct GatherWindows<'a> {
    x: &'a Batch<'a>,
    tiles: Range<usize>,
    block: Gathered,
    scratch: &'a mut [f32],
}

impl<'a> GatherWindows<'a> {
    /// # Safety
    /// The contract of [`TileSource::gather`], until the kernel has run.
    unsafe fn new(
        x: &'a Batch<'a>,
        tiles: Range<usize>,
        block: Gathered,
        scratch: &'a mut [f32],
    ) -> Self {
        Self {
            x,
            tiles,
            block,
            scratch,
        }
    }
}

impl Kernel for GatherWindows<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: the contract of `new`.
        unsafe { self.x.gather(simd, self.tiles, self.block, self.scratch) }
    }
}

/// Transforms the output gradients of a run of tiles.
struct GatherGradients<'a> {
    grad_y: &'a Batch<'a>,
    tiles: Range<usize>,
    block: Product,
    scratch: &'a mut [f32],
}

impl<'a> GatherGradients<'a> {
    /// # Safety
    /// The contract of [`Batch::gather_gradients`], until the kernel has run.
    unsafe fn new(
        grad_y: &'a Batch<'a>,
        tiles: Range<usize>,
        block: Product,
        scratch: &'a mut [f32],
    ) -> Self {
        Self {
            grad_y,
            tiles,
            block,
            scratch,
        }
    }
}

impl Kernel for GatherGradients<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: the contract of `new`.
        unsafe {
            self.grad_y
                .gather_gradients(simd, self.tiles, self.block, self.scratch)
        }
    }
}

/// Transforms the sums of 16 input channels of a panel back to kernels: `taps` becomes `[16][9][width]`.
struct Finalise<'a> {
    sums: Sums,
    panel: usize,
    channel: usize,
    taps: &'a mut [f32],
}

impl<'a> Finalise<'a> {
    /// # Safety
    /// The panel and 16 channels from `channel` on must exist, and no other thread may write their sums until the kernel
    /// has run.
    unsafe fn new(sums: Sums, panel: usize, channel: usize, taps: &'a mut [f32]) -> Self {
        Self {
            sums,
            panel,
            channel,
            taps,
        }
    }
}

impl Kernel for Finalise<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let width = self.sums.shape.width(self.panel);
        assert!(self.taps.len() >= CHANNEL_BLOCK * 9 * width);
        let out = self.taps.as_mut_ptr();
        for i in 0..CHANNEL_BLOCK {
            for j in (0..width).step_by(S::LANES) {
                // SAFETY: inside the sums by the contract of `new`, and inside `taps` as asserted.
                unsafe {
                    weight_gradient(
                        simd,
                        |point| simd.load(self.sums.at(point, self.panel, self.channel + i).add(j)),
                        |tap, value| simd.store(out.add((i * 9 + tap) * width + j), value),
                    );
                }
            }
        }
    }
}
