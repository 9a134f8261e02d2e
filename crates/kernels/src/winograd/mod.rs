//! Winograd convolution F(4x4, 3x3), stride 1: a quarter of the multiplications of the direct way.
//!
//! Tiles of 4x4 outputs are made from 6x6 windows of the input. Windows, kernels and tiles are transformed linearly
//! ([`transform`]), and at each of the 36 transformed points the sum over channels is a matrix product of tiles by
//! output channels. A worker takes a *chunk* of tiles that fits in its cache through all three steps; where the
//! transformed kernels are too large to be read once per chunk, all workers share one large chunk, step by step.
//!
//! Lavin & Gray, *Fast Algorithms for Convolutional Neural Networks*, 2016. Against f64 the largest error is below
//! 1e-5 of the largest output (direct convolution: 2e-6).

mod image;
pub(crate) mod transform;
mod weights;

use std::ops::Range;

pub(crate) use image::{TensorSink, TensorSource};
pub(crate) use weights::{Direction, WinogradWeights};

use crate::Workspace;
use crate::panel::{Finish, PanelRun, PanelShape, Taps};
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;
use transform::POINTS;

/// Scratch of a worker that should stay in its second-level cache.
const CACHED_BYTES: usize = 768 << 10;
/// Transformed kernels above this are read by all workers together.
const LARGE_WEIGHTS_BYTES: usize = 4 << 20;
/// Scratch of a chunk that all workers share, which should stay in the last-level cache.
const SHARED_BYTES: usize = 12 << 20;
/// Tiles in a chunk are a multiple of this, the rows of the matrix products' widest register block.
const TILE_ROWS: usize = 12;

/// Where transformed windows come from.
pub(crate) trait TileSource: Sync {
    /// Floats of scratch that `gather` needs for a chunk of `tiles` tiles.
    fn scratch(&self, tiles: usize) -> usize;
    /// Transforms the windows of `tiles` into `block`, the first at row 0.
    ///
    /// # Safety
    /// The tiles must exist; `block` must have room for them and be written by nobody else meanwhile.
    unsafe fn gather<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Gathered,
        scratch: &mut [f32],
    );
}

/// Where products go.
pub(crate) trait TileSink: Sync {
    /// Floats of scratch that `scatter` needs for a chunk of `tiles` tiles.
    fn scratch(&self, tiles: usize) -> usize;
    /// Transforms the products of `tiles` in `block`, the first at row 0, and writes the output tiles.
    ///
    /// # Safety
    /// The tiles must exist; `block` must hold them; nobody else may touch their outputs meanwhile.
    unsafe fn scatter<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Product,
        scratch: &mut [f32],
    );
}

/// A cache line more than the floats of a point, so that the points do not all fall into one set of the cache.
#[inline(always)]
pub(crate) fn padded_stride(floats: usize) -> usize {
    floats + CHANNEL_BLOCK
}

/// Transformed windows of up to `capacity` tiles: `[point][channel block][tile][16]`.
#[derive(Clone, Copy)]
pub(crate) struct Gathered {
    memory: SharedMut,
    capacity: usize,
    depth: usize,
}

impl Gathered {
    /// In memory of [`Self::floats_for`] floats.
    pub(crate) fn new(memory: &mut [f32], capacity: usize, depth: usize) -> Self {
        assert!(memory.len() >= Self::floats_for(capacity, depth));
        Self {
            memory: SharedMut::new(memory),
            capacity,
            depth,
        }
    }

    pub(crate) fn floats_for(capacity: usize, depth: usize) -> usize {
        POINTS * padded_stride(capacity * depth)
    }

    /// Floats from one point to the next.
    #[inline(always)]
    pub(crate) fn point_stride(&self) -> usize {
        padded_stride(self.capacity * self.depth)
    }

    /// Offset of a tile's channel within a point.
    #[inline(always)]
    pub(crate) fn offset(&self, tile: usize, channel: usize) -> usize {
        (channel / CHANNEL_BLOCK * self.capacity + tile) * CHANNEL_BLOCK + channel % CHANNEL_BLOCK
    }

    /// # Safety
    /// The offset must lie inside.
    #[inline(always)]
    pub(crate) unsafe fn at(&self, offset: usize) -> *mut f32 {
        // SAFETY: the caller's promise.
        unsafe { self.memory.at(offset) }
    }

    /// The block from row `tile` on.
    pub(crate) fn starting_at(self, tile: usize) -> Self {
        // SAFETY: rows of a block that holds them.
        unsafe {
            Self {
                memory: self.memory.moved(tile * CHANNEL_BLOCK),
                ..self
            }
        }
    }
}

/// Products of up to `capacity` tiles: `[point][panel][tile][width]`.
#[derive(Clone, Copy)]
pub(crate) struct Product {
    memory: SharedMut,
    capacity: usize,
    shape: PanelShape,
    first_tile: usize,
}

impl Product {
    /// In memory of [`Self::floats_for`] floats.
    pub(crate) fn new(memory: &mut [f32], capacity: usize, shape: PanelShape) -> Self {
        assert!(memory.len() >= Self::floats_for(capacity, shape));
        Self {
            memory: SharedMut::new(memory),
            capacity,
            shape,
            first_tile: 0,
        }
    }

    pub(crate) fn floats_for(capacity: usize, shape: PanelShape) -> usize {
        POINTS * padded_stride(capacity * shape.columns())
    }

    /// Floats from one point to the next.
    #[inline(always)]
    pub(crate) fn point_stride(&self) -> usize {
        padded_stride(self.capacity * self.shape.columns())
    }

    /// Offset of a tile's output channel within a point.
    #[inline(always)]
    pub(crate) fn offset(&self, tile: usize, channel: usize) -> usize {
        let panel = self.shape.panel_of(channel);
        let start = self.shape.start(panel);
        start * self.capacity + (self.first_tile + tile) * self.shape.width(panel) + channel - start
    }

    /// # Safety
    /// The offset must lie inside.
    #[inline(always)]
    pub(crate) unsafe fn at(&self, offset: usize) -> *mut f32 {
        // SAFETY: the caller's promise.
        unsafe { self.memory.at(offset) }
    }

    /// The block from row `tile` on.
    pub(crate) fn starting_at(self, tile: usize) -> Self {
        Self {
            first_tile: tile,
            ..self
        }
    }
}

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
    let small = rows_in(CACHED_BYTES).max(2 * TILE_ROWS);
    if weights.bytes() <= LARGE_WEIGHTS_BYTES
        && tiles.div_ceil(small) >= 2 * rayon::current_num_threads()
    {
        each_its_own(weights, tiles, small, source, sink, workspace);
    } else {
        all_together(
            weights,
            tiles,
            rows_in(SHARED_BYTES).max(4 * TILE_ROWS),
            source,
            sink,
            workspace,
        );
    }
}

/// Every worker takes chunks of tiles through all steps.
fn each_its_own(
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
            weights.isa().run(Chunk {
                weights,
                tiles,
                source,
                sink,
                gathered,
                product,
                scratch,
            });
        },
    );
}

struct Chunk<'a, I, O> {
    weights: &'a WinogradWeights,
    tiles: Range<usize>,
    source: &'a I,
    sink: &'a O,
    gathered: Gathered,
    product: Product,
    scratch: &'a mut [f32],
}

impl<I: TileSource, O: TileSink> Kernel for Chunk<'_, I, O> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let shape = self.weights.shape();
        // The chunk's memory is this worker's own and has room for its tiles, whose outputs are written by this chunk
        // alone: what the three steps ask for.
        let Self {
            weights,
            tiles,
            source,
            sink,
            gathered,
            product,
            scratch,
        } = self;
        simd.run(Gather {
            source,
            tiles: tiles.clone(),
            block: gathered,
            scratch: &mut *scratch,
        });
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
        simd.run(Scatter {
            sink,
            tiles,
            block: product,
            scratch,
        });
    }
}

/// All workers take one chunk of tiles after the other through the steps together.
fn all_together(
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
    // Enough pieces to balance the workers, not so small that handing them out costs.
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
        for_each(scratch, source.scratch(run), runs, |scratch, i| {
            let rows = rows(i);
            isa.run(Gather {
                source,
                tiles: tiles(&rows),
                block: gathered.starting_at(rows.start),
                scratch,
            });
        });
        let groups = shape.count().div_ceil(panels);
        for_each(scratch, 0, POINTS * groups, |_, unit| {
            let (point, group) = (unit / groups, unit % groups);
            for panel in group * panels..((group + 1) * panels).min(shape.count()) {
                isa.run(multiply(weights, point, panel, count, gathered, product));
            }
        });
        for_each(scratch, sink.scratch(run), runs, |scratch, i| {
            let rows = rows(i);
            isa.run(Scatter {
                sink,
                tiles: tiles(&rows),
                block: product.starting_at(rows.start),
                scratch,
            });
        });
    }
}

/// The products of all tiles of a chunk with one panel at one point.
fn multiply(
    weights: &WinogradWeights,
    point: usize,
    panel: usize,
    tiles: usize,
    gathered: Gathered,
    product: Product,
) -> PanelRun {
    let shape = weights.shape();
    // SAFETY: both offsets lie inside the blocks.
    let (a, out) = unsafe {
        (
            gathered.at(point * gathered.point_stride()),
            product.at(point * product.point_stride() + shape.start(panel) * product.capacity),
        )
    };
    PanelRun {
        a,
        row_stride: CHANNEL_BLOCK,
        depth_stride: 1,
        taps: Taps::line(
            weights.depth() / CHANNEL_BLOCK,
            gathered.capacity * CHANNEL_BLOCK,
        ),
        depth: CHANNEL_BLOCK,
        b: weights.panel(point, panel).as_ptr(),
        b_stride: shape.width(panel),
        width: shape.width(panel),
        out,
        out_stride: shape.width(panel),
        rows: tiles,
        finish: Finish::Store,
    }
}

struct Gather<'a, I> {
    source: &'a I,
    tiles: Range<usize>,
    block: Gathered,
    scratch: &'a mut [f32],
}

impl<I: TileSource> Kernel for Gather<'_, I> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: whoever made this gave it existing tiles and rows of a block that no one else writes.
        unsafe {
            self.source
                .gather(simd, self.tiles, self.block, self.scratch)
        }
    }
}

struct Scatter<'a, O> {
    sink: &'a O,
    tiles: Range<usize>,
    block: Product,
    scratch: &'a mut [f32],
}

impl<O: TileSink> Kernel for Scatter<'_, O> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // SAFETY: whoever made this gave it existing tiles, whose outputs no one else writes.
        unsafe {
            self.sink
                .scatter(simd, self.tiles, self.block, self.scratch)
        }
    }
}
