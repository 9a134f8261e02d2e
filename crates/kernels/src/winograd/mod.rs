//! Winograd convolution F(4x4, 3x3), stride 1: a quarter of the multiplications of direct convolution.
//!
//! Tiles of 4x4 outputs are computed from 6x6 windows of the input. Windows, kernels and tiles are transformed linearly
//! ([`transform`]), and at each of the 36 transformed points the sum over channels is a matrix product of tiles by
//! output channels. A worker takes a *chunk* of tiles that fits in its cache through all three steps (gather, multiply,
//! scatter); if the transformed kernels are too large to be read once per chunk, all workers share one large chunk, step
//! by step.
//!
//! Lavin & Gray, *Fast Algorithms for Convolutional Neural Networks*, 2016. Compared with f64 the largest error is below
//! 1e-5 of the largest output (direct convolution: 2e-6).

mod blocks;
mod image;
mod tiles;
pub(crate) mod transform;
mod weights;

use std::ops::Range;

pub(crate) use blocks::{Gathered, Product, padded_stride};
pub(crate) use image::{TensorSink, TensorSource};
pub(crate) use tiles::{TileSink, TileSource};
pub(crate) use weights::{Direction, WinogradWeights};

use crate::Workspace;
use crate::cache::l2_bytes;
use crate::panel::{Finish, LeftRows, OutputRows, PanelProduct, RightPanel, Taps};
use crate::parallel::for_each;
use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;
use transform::POINTS;

/// Quarters of the L2 cache that a worker's scratch memory takes.
const CACHED_QUARTERS: usize = 3;
/// If the transformed kernels are larger than this, all workers share one chunk.
const LARGE_WEIGHTS_BYTES: usize = 4 << 20;
/// Size of the scratch memory of a shared chunk, which should stay in the last-level cache.
const SHARED_BYTES: usize = 12 << 20;
/// Tiles in a chunk are a multiple of this, the largest micro-tile's rows (mr).
const TILE_ROWS: usize = 12;

/// Convolves `tiles` tiles from `source` to `sink`.
pub(crate) fn convolve(
    weights: &WinogradWeights,
    tiles: usize,
    source: &impl TileSource,
    sink: &impl TileSink,
    workspace: &mut Workspace,
) {
    if tiles == 0 {
        return;
    }
    let bytes_of_tile = POINTS * (weights.depth() + weights.shape().columns()) * size_of::<f32>();
    let rows_in = |bytes: usize| (bytes / bytes_of_tile / TILE_ROWS).max(1) * TILE_ROWS;
    let small = rows_in(l2_bytes() / 4 * CACHED_QUARTERS).max(2 * TILE_ROWS);
    if weights.bytes() <= LARGE_WEIGHTS_BYTES
        && tiles.div_ceil(small) >= 2 * rayon::current_num_threads()
    {
        convolve_by_worker(weights, tiles, small, source, sink, workspace);
    } else {
        convolve_shared(
            weights,
            tiles,
            rows_in(SHARED_BYTES).max(4 * TILE_ROWS),
            source,
            sink,
            workspace,
        );
    }
}

/// Each worker takes chunks of tiles through all steps.
fn convolve_by_worker(
    weights: &WinogradWeights,
    tiles: usize,
    capacity: usize,
    source: &impl TileSource,
    sink: &impl TileSink,
    workspace: &mut Workspace,
) {
    let (depth, shape) = (weights.depth(), weights.shape());
    let (windows, products) = (
        Gathered::floats_for(capacity, depth),
        Product::floats_for(capacity, shape),
    );
    let extra = source.scratch(capacity).max(sink.scratch(capacity));
    for_each(
        &mut workspace.workers,
        windows + products + extra,
        tiles.div_ceil(capacity),
        |memory, chunk| {
            let (gathered, rest) = memory.split_at_mut(windows);
            let (product, scratch) = rest.split_at_mut(products);
            let gathered = Gathered::new(gathered, capacity, depth);
            let product = Product::new(product, capacity, shape);
            let tiles = chunk * capacity..((chunk + 1) * capacity).min(tiles);
            // SAFETY: the memory is this worker's own and has room for the tiles, whose outputs are written by this task
            // alone.
            weights.isa().run(unsafe {
                Chunk::new(weights, tiles, source, sink, gathered, product, scratch)
            });
        },
    );
}

/// All three steps for a chunk of tiles.
struct Chunk<'a, I, O> {
    weights: &'a WinogradWeights,
    tiles: Range<usize>,
    source: &'a I,
    sink: &'a O,
    gathered: Gathered,
    product: Product,
    scratch: &'a mut [f32],
}

impl<'a, I: TileSource, O: TileSink> Chunk<'a, I, O> {
    /// # Safety
    /// The contracts of [`TileSource::gather`] and [`TileSink::scatter`] for these tiles and blocks, until the kernel has
    /// run; no other thread may use the blocks.
    unsafe fn new(
        weights: &'a WinogradWeights,
        tiles: Range<usize>,
        source: &'a I,
        sink: &'a O,
        gathered: Gathered,
        product: Product,
        scratch: &'a mut [f32],
    ) -> Self {
        Self {
            weights,
            tiles,
            source,
            sink,
            gathered,
            product,
            scratch,
        }
    }
}

impl<I: TileSource, O: TileSink> Kernel for Chunk<'_, I, O> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let shape = self.weights.shape();
        let Self {
            weights,
            tiles,
            source,
            sink,
            gathered,
            product,
            scratch,
        } = self;
        // SAFETY: the contract of `new`, which is that of the three steps; each runs before the next is made.
        unsafe {
            simd.run(Gather::new(source, tiles.clone(), gathered, &mut *scratch));
            for point in 0..POINTS {
                for panel in 0..shape.count() {
                    simd.run(multiply(
                        weights,
                        point,
                        panel,
                        tiles.len(),
                        gathered,
                        product,
                    ));
                }
            }
            simd.run(Scatter::new(sink, tiles, product, scratch));
        }
    }
}

/// All workers share one chunk of tiles after the other, step by step.
fn convolve_shared(
    weights: &WinogradWeights,
    tiles: usize,
    capacity: usize,
    source: &impl TileSource,
    sink: &impl TileSink,
    workspace: &mut Workspace,
) {
    let capacity = capacity.min(tiles.next_multiple_of(TILE_ROWS));
    let (isa, depth, shape) = (weights.isa(), weights.depth(), weights.shape());
    let (windows, products) = (
        Gathered::floats_for(capacity, depth),
        Product::floats_for(capacity, shape),
    );
    let Workspace {
        shared,
        workers: scratch,
    } = workspace;
    let (gathered, product) = shared.floats(windows + products).split_at_mut(windows);
    let gathered = Gathered::new(gathered, capacity, depth);
    let product = Product::new(product, capacity, shape);

    let workers = rayon::current_num_threads();
    // Enough tasks to balance the workers, but not so small that scheduling takes noticeable time.
    let run = capacity.div_ceil(4 * workers).max(2);
    let panels = if workers > 8 {
        1
    } else {
        shape.count().div_ceil(2)
    };
    for first in (0..tiles).step_by(capacity) {
        let count = capacity.min(tiles - first);
        let runs = count.div_ceil(run);
        let rows = |i: usize| i * run..((i + 1) * run).min(count);
        let tiles = |rows: &Range<usize>| first + rows.start..first + rows.end;
        // SAFETY (of the three steps): the blocks have room for the tiles of the chunk; each task has its own rows, or its
        // own panels at a point, or its own outputs; the steps run one after the other.
        for_each(scratch, source.scratch(run), runs, |scratch, i| {
            let rows = rows(i);
            let block = gathered.starting_at(rows.start);
            // SAFETY: see above.
            isa.run(unsafe { Gather::new(source, tiles(&rows), block, scratch) });
        });
        let groups = shape.count().div_ceil(panels);
        for_each(scratch, 0, POINTS * groups, |_, task| {
            let (point, group) = (task / groups, task % groups);
            for panel in group * panels..((group + 1) * panels).min(shape.count()) {
                // SAFETY: see above.
                isa.run(unsafe { multiply(weights, point, panel, count, gathered, product) });
            }
        });
        for_each(scratch, sink.scratch(run), runs, |scratch, i| {
            let rows = rows(i);
            let block = product.starting_at(rows.start);
            // SAFETY: see above.
            isa.run(unsafe { Scatter::new(sink, tiles(&rows), block, scratch) });
        });
    }
}

/// The products of all tiles of a chunk with one panel at one point.
///
/// # Safety
/// `tiles` must not exceed the capacity of the blocks, and the first `tiles` rows of `gathered` must be filled. Until the
/// kernel has run, no other thread may read or write these rows of `product` at this point and panel.
unsafe fn multiply(
    weights: &WinogradWeights,
    point: usize,
    panel: usize,
    tiles: usize,
    gathered: Gathered,
    product: Product,
) -> PanelProduct {
    let shape = weights.shape();
    // SAFETY: both offsets lie inside the blocks.
    let (a, out) = unsafe {
        (
            gathered.at(point * gathered.point_stride()),
            product.at(point * product.point_stride() + shape.start(panel) * product.capacity),
        )
    };
    let left = LeftRows {
        start: a,
        rows: tiles,
        row_stride: CHANNEL_BLOCK,
        taps: Taps::line(
            weights.depth() / CHANNEL_BLOCK,
            gathered.capacity * CHANNEL_BLOCK,
        ),
        depth: CHANNEL_BLOCK,
        depth_stride: 1,
    };
    let right = RightPanel::packed(weights.panel(point, panel), shape.width(panel));
    let out = OutputRows {
        start: out,
        row_stride: shape.width(panel),
    };
    // SAFETY: the caller's contract; `tiles` rows fit into both blocks.
    unsafe { PanelProduct::new(left, right, out, Finish::Store) }
}

/// Transforms the windows of a run of tiles.
struct Gather<'a, I> {
    source: &'a I,
    tiles: Range<usize>,
    block: Gathered,
    scratch: &'a mut [f32],
}

impl<'a, I: TileSource> Gather<'a, I> {
    /// # Safety
    /// The contract of [`TileSource::gather`], until the kernel has run.
    unsafe fn new(
        source: &'a I,
        tiles: Range<usize>,
        block: Gathered,
        scratch: &'a mut [f32],
    ) -> Self {
        Self {
            source,
            tiles,
            block,
            scratch,
        }
    }
}

impl<I: TileSource> Kernel for Gather<'_, I> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: the contract of `new`.
        unsafe {
            self.source
                .gather(simd, self.tiles, self.block, self.scratch)
        }
    }
}

/// Writes the output of a run of tiles.
struct Scatter<'a, O> {
    sink: &'a O,
    tiles: Range<usize>,
    block: Product,
    scratch: &'a mut [f32],
}

impl<'a, O: TileSink> Scatter<'a, O> {
    /// # Safety
    /// The contract of [`TileSink::scatter`], until the kernel has run.
    unsafe fn new(
        sink: &'a O,
        tiles: Range<usize>,
        block: Product,
        scratch: &'a mut [f32],
    ) -> Self {
        Self {
            sink,
            tiles,
            block,
            scratch,
        }
    }
}

impl<O: TileSink> Kernel for Scatter<'_, O> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: the contract of `new`.
        unsafe {
            self.sink
                .scatter(simd, self.tiles, self.block, self.scratch)
        }
    }
}
