//! A block that is put together from parts of others.

use crate::block::{Block, Validity};

/// Pixels that parts of blocks are painted on; without data at first.
pub(crate) struct BlockCanvas {
    width: usize,
    rgb: Vec<u8>,
    mask: Vec<u8>,
}

/// A rectangle to be copied, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    /// Left and top edge in the block.
    pub from: (usize, usize),
    /// Left and top edge on the canvas.
    pub to: (usize, usize),
    /// Width and height.
    pub size: (usize, usize),
}

impl BlockCanvas {
    /// An empty canvas.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            rgb: vec![0; width * height * 3],
            mask: vec![0; width * height],
        }
    }

    /// Paints those pixels of a part of `block` that have data over what is there. The part must lie in the block and
    /// on the canvas.
    pub fn paint(&mut self, block: &Block, part: Part) {
        if block.validity == Validity::None {
            return;
        }
        let (columns, rows) = part.size;
        for row in 0..rows {
            let from = (part.from.1 + row) * block.width + part.from.0;
            let to = (part.to.1 + row) * self.width + part.to.0;
            match &block.validity {
                Validity::Mask(seen) => {
                    for i in (0..columns).filter(|i| seen[from + i] != 0) {
                        self.rgb[(to + i) * 3..(to + i + 1) * 3]
                            .copy_from_slice(&block.rgb[(from + i) * 3..(from + i + 1) * 3]);
                        self.mask[to + i] = 255;
                    }
                }
                _ => {
                    self.rgb[to * 3..(to + columns) * 3]
                        .copy_from_slice(&block.rgb[from * 3..(from + columns) * 3]);
                    self.mask[to..to + columns].fill(255);
                }
            }
        }
    }

    /// The finished block.
    pub fn finish(self) -> Block {
        let validity = Validity::from_mask(self.mask);
        if validity == Validity::None {
            return Block::empty(self.width);
        }
        Block {
            width: self.width,
            rgb: self.rgb,
            validity,
        }
    }
}
