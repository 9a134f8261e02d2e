//! Blocks: the units in which the pixels of a map are decoded.

use crate::GeoError;

/// Size of one resolution of a map, and of the blocks it is decoded in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BlockLayout {
    /// Width, pixels of this resolution.
    pub width: u64,
    /// Height.
    pub height: u64,
    /// Width of a block; blocks at the right edge are cut.
    pub block_w: u64,
    /// Height of a block; blocks at the lower edge are cut.
    pub block_h: u64,
}

impl BlockLayout {
    /// Columns of pixels `[start, end)` of a column of blocks.
    pub fn columns_of(&self, block_column: u64) -> (u64, u64) {
        let start = block_column * self.block_w;
        (start, (start + self.block_w).min(self.width))
    }

    /// Rows of pixels `[start, end)` of a row of blocks.
    pub fn rows_of(&self, block_row: u64) -> (u64, u64) {
        let start = block_row * self.block_h;
        (start, (start + self.block_h).min(self.height))
    }
}

/// Which pixels of a block have data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Validity {
    /// All of them.
    All,
    /// None; the block has no colours either (`rgb` is empty).
    None,
    /// 255 where there is data, else 0; row-major.
    Mask(Vec<u8>),
}

impl Validity {
    /// From a mask; the variants without a mask are preferred.
    pub fn from_mask(mask: Vec<u8>) -> Self {
        if mask.iter().all(|&v| v != 0) {
            Self::All
        } else if mask.iter().all(|&v| v == 0) {
            Self::None
        } else {
            Self::Mask(mask)
        }
    }
}

/// Decoded pixels of a block.
#[derive(Debug, Clone)]
pub(crate) struct Block {
    /// Width, pixels, after cutting at the edge.
    pub width: usize,
    /// Interleaved 8-bit RGB, row-major; empty if nothing is valid.
    pub rgb: Vec<u8>,
    /// Where there is data.
    pub validity: Validity,
}

impl Block {
    /// A block without data.
    pub fn empty(width: usize) -> Self {
        Self {
            width,
            rgb: Vec::new(),
            validity: Validity::None,
        }
    }

    /// Approximate size in memory, bytes.
    pub fn bytes(&self) -> usize {
        let mask = match &self.validity {
            Validity::Mask(mask) => mask.len(),
            Validity::All | Validity::None => 0,
        };
        // 256 for the block itself and its place in the cache.
        256 + self.rgb.len() + mask
    }
}

/// A map as blocks, at its own and at coarser resolutions.
pub(crate) trait BlockSource: Send + Sync {
    /// Resolutions, finest (the map itself) first. Never empty. All cover the same ground.
    fn levels(&self) -> &[BlockLayout];

    /// Decodes a block.
    fn decode(&self, level: usize, column: u64, row: u64) -> Result<Block, GeoError>;
}
