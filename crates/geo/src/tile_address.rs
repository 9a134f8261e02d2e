//! Which tile of the Web Mercator grid.

use std::fmt;

/// Finest zoom of the grid that is read: columns and rows fit 32 bits.
pub(crate) const MAX_ZOOM: u8 = 30;

/// A tile in the XYZ scheme: rows are counted from the north.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct TileAddress {
    /// The whole world is `2^zoom` tiles wide and high.
    pub zoom: u8,
    /// From the antimeridian eastwards.
    pub column: u32,
    /// From 85.05 degrees north southwards.
    pub row: u32,
}

impl TileAddress {
    /// A tile, if the grid has it.
    pub fn new(zoom: u64, column: u64, row: u64) -> Option<Self> {
        let zoom = u8::try_from(zoom).ok().filter(|&zoom| zoom <= MAX_ZOOM)?;
        let side = 1_u64 << zoom;
        (column < side && row < side).then_some(Self {
            zoom,
            column: column as u32,
            row: row as u32,
        })
    }

    /// The same place with rows counted from the south (TMS), or back.
    pub fn flipped(self) -> Self {
        Self {
            row: ((1_u64 << self.zoom) - 1 - u64::from(self.row)) as u32,
            ..self
        }
    }
}

impl fmt::Display for TileAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.zoom, self.column, self.row)
    }
}
