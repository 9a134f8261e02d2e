//! Input and output of a Winograd convolution by tiles.

use std::ops::Range;

use super::blocks::{Gathered, Product};
use crate::simd::Simd;

/// The input of a convolution by tiles.
pub(crate) trait TileSource: Sync {
    /// Floats of scratch that `gather` needs for a chunk of `tiles` tiles.
    fn scratch(&self, tiles: usize) -> usize;
    /// Transforms the windows of `tiles` into `block`, the first at row 0.
    ///
    /// # Safety
    /// The tiles must exist; `scratch` must have at least the length that [`TileSource::scratch`] states; `block` must have room for
    /// the tiles, and no other thread may read or write these rows of it.
    unsafe fn gather<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Gathered,
        scratch: &mut [f32],
    );
}

/// The output of a convolution by tiles.
pub(crate) trait TileSink: Sync {
    /// Floats of scratch that `scatter` needs for a chunk of `tiles` tiles.
    fn scratch(&self, tiles: usize) -> usize;
    /// Transforms the products of `tiles` in `block`, the first at row 0, and writes the output tiles.
    ///
    /// # Safety
    /// The tiles must exist; `scratch` must have at least the length that [`TileSink::scratch`] states; `block` must hold the tiles;
    /// no other thread may read or write their outputs.
    unsafe fn scatter<S: Simd>(
        &self,
        simd: S,
        tiles: Range<usize>,
        block: Product,
        scratch: &mut [f32],
    );
}
