//! Blocks of transformed tiles in scratch memory.

use super::transform::POINTS;
use crate::panel::PanelShape;
use crate::parallel::SharedMut;
use crate::tensor::CHANNEL_BLOCK;

/// Floats from one point to the next: a cache line more than a point has, so that the points do not all map to one set
/// of the cache.
#[inline(always)]
pub(crate) fn padded_stride(floats: usize) -> usize {
    floats + CHANNEL_BLOCK
}

/// Transformed windows of up to `capacity` tiles: `[point][channel block][tile][16]`.
#[derive(Clone, Copy)]
pub(crate) struct Gathered {
    memory: SharedMut,
    /// Tiles that have room.
    pub(super) capacity: usize,
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
    /// The offset must lie within the block.
    #[inline(always)]
    pub(crate) unsafe fn at(&self, offset: usize) -> *mut f32 {
        // SAFETY: the caller's contract.
        unsafe { self.memory.at(offset) }
    }

    /// The block from row `tile` on.
    pub(crate) fn starting_at(self, tile: usize) -> Self {
        assert!(tile <= self.capacity, "first row of a Winograd block");
        // SAFETY: checked above; each row has `CHANNEL_BLOCK` floats in the first channel block.
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
    /// Tiles that have room.
    pub(super) capacity: usize,
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
    /// The offset must lie within the block.
    #[inline(always)]
    pub(crate) unsafe fn at(&self, offset: usize) -> *mut f32 {
        // SAFETY: the caller's contract.
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
