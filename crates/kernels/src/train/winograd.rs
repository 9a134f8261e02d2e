//! Gradient of a 3x3 kernel through Winograd's points.
//!
//! Forward is `y = A^T [sum over channels (G g G^T) * (B^T d B)] A`, so the gradient of a kernel is
//! `G^T [sum over tiles (A dy A^T) * (B^T d B)] G`: at each point a product of channels by output channels whose depth is
//! the tiles of the whole batch.

use std::ops::Range;

use super::tiles::Batch;
use crate::buffer::AlignedBuffer;
use crate::layout::block_channels;
use crate::panel::{Finish, PanelRun, PanelShape, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;
use crate::winograd::transform::{POINTS, weight_gradient};
use crate::winograd::{Gathered, Product, TileSource, padded_stride};
use crate::{Isa, Workspace};

/// Both sides of the products should stay in the last-level cache.
const SHARED_BYTES: usize = 16 << 20;
/// Fewest tiles in a chunk: sums are read and written once for each.
const FEWEST_TILES: usize = 96;
/// Tiles that a worker transforms in one piece.
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
        let count = capacity.min(tiles - first);
        let pieces = count.div_ceil(PIECE);
        let scratch_floats = x.scratch(PIECE).max(grad_y.gradients_scratch());
        for_each(scratch, scratch_floats, 2 * pieces, |scratch, unit| {
            let rows = unit / 2 * PIECE..(unit / 2 * PIECE + PIECE).min(count);
            let tiles = first + rows.start..first + rows.end;
            if unit % 2 == 0 {
                isa.run(GatherWindows {
                    x,
                    tiles,
                    block: windows.starting_at(rows.start),
                    scratch,
                });
            } else {
                isa.run(GatherGradients {
                    grad_y,
                    tiles,
                    block: gradients.starting_at(rows.start),
                    scratch,
                });
            }
        });
        for_each(scratch, 0, POINTS * shape.count(), |_, unit| {
            let (point, panel) = (unit / shape.count(), unit % shape.count());
            for channel in (0..depth).step_by(CHANNEL_BLOCK) {
                // SAFETY: inside the blocks, whose first `count` rows are filled; the sums of this point and panel
                // belong to this unit.
                let run = unsafe {
                    PanelRun {
                        a: windows.at(point * windows.point_stride() + windows.offset(0, channel)),
                        row_stride: 1,
                        depth_stride: CHANNEL_BLOCK,
                        taps: Taps::ONE,
                        depth: count,
                        b: gradients.at(point * gradients.point_stride()
                            + gradients.offset(0, shape.start(panel))),
                        b_stride: shape.width(panel),
                        width: shape.width(panel),
                        out: sums.at(point, panel, channel),
                        out_stride: shape.width(panel),
                        rows: CHANNEL_BLOCK,
                        finish: if first == 0 {
                            Finish::Store
                        } else {
                            Finish::Add
                        },
                    }
                };
                isa.run(run);
            }
        });
    }

    let blocks = depth / CHANNEL_BLOCK;
    let out = SharedMut::new(grad_weight);
    for_each(
        scratch,
        9 * CHANNEL_BLOCK * shape.width(0),
        shape.count() * blocks,
        |taps, unit| {
            let (panel, channel) = (unit / blocks, unit % blocks * CHANNEL_BLOCK);
            let (start, width) = (shape.start(panel), shape.width(panel));
            isa.run(Finalise {
                sums,
                panel,
                channel,
                taps,
            });
            let channels = block_channels(inputs, channel);
            for j in 0..width.min(outputs.saturating_sub(start)) {
                // SAFETY: the kernels of one output channel and up to 16 input channels, which belong to this unit.
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
        // SAFETY: the caller's promise.
        unsafe {
            self.memory
                .at(point * Self::point_stride(self.depth, self.shape) + in_point)
        }
    }
}

struct GatherWindows<'a> {
    x: &'a Batch<'a>,
    tiles: Range<usize>,
    block: Gathered,
    scratch: &'a mut [f32],
}

impl Kernel for GatherWindows<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: whoever made this gave it existing tiles and rows of a block that no one else writes.
        unsafe { self.x.gather(simd, self.tiles, self.block, self.scratch) }
    }
}

struct GatherGradients<'a> {
    grad_y: &'a Batch<'a>,
    tiles: Range<usize>,
    block: Product,
    scratch: &'a mut [f32],
}

impl Kernel for GatherGradients<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: as for `GatherWindows`.
        unsafe {
            self.grad_y
                .gather_gradients(simd, self.tiles, self.block, self.scratch)
        }
    }
}

/// Takes 16 input channels of a panel back from the points: `taps` becomes `[16][9][width]`.
struct Finalise<'a> {
    sums: Sums,
    panel: usize,
    channel: usize,
    taps: &'a mut [f32],
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
                // SAFETY: inside the sums and inside `taps`, as asserted.
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
