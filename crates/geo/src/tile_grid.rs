//! Tiles over a level: equation (1) of the paper, and a plan that leaves no margin out.

use serde::{Deserialize, Serialize};

use crate::GeoError;

/// Which tiles there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TilePlan {
    /// The paper's equation (1): tiles at whole strides, as long as they fit. What remains at the
    /// right and lower edge is not covered, and a map smaller than a tile has no tiles.
    Paper,
    /// As many tiles as needed to cover everything: the last column and row are moved back to end
    /// at the edge. A map smaller than a tile has one tile, which reaches beyond it.
    Clamped,
}

/// A tile's place in a grid, pixels of the level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tile {
    /// Row, from the top.
    pub row: u64,
    /// Column, from the left.
    pub column: u64,
    /// Left edge.
    pub x_px: u64,
    /// Top edge.
    pub y_px: u64,
    /// Side.
    pub side_px: u64,
}

impl Tile {
    /// Its centre in continuous level pixels.
    pub fn centre_px(&self) -> (f64, f64) {
        let half = self.side_px as f64 / 2.0;
        (self.x_px as f64 + half, self.y_px as f64 + half)
    }
}

/// A grid of square, overlapping tiles over a level of given size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileGrid {
    width_px: u64,
    height_px: u64,
    tile_px: u64,
    stride_px: u64,
    plan: TilePlan,
    columns: u64,
    rows: u64,
}

impl TileGrid {
    /// The paper's tile side, pixels.
    pub const TILE_PX: u64 = 512;
    /// The paper's stride, pixels: half a tile.
    pub const STRIDE_PX: u64 = 256;

    /// A grid over `width_px` x `height_px` of tiles of side `tile_px`, `stride_px` apart.
    ///
    /// # Errors
    /// [`GeoError::BadGrid`] if a side is zero or the stride exceeds the tile (the plan would have
    /// holes).
    pub fn new(
        width_px: u64,
        height_px: u64,
        tile_px: u64,
        stride_px: u64,
        plan: TilePlan,
    ) -> Result<Self, GeoError> {
        if width_px == 0 || height_px == 0 || tile_px == 0 || stride_px == 0 {
            return Err(GeoError::BadGrid(
                "level, tile and stride must be above zero".to_string(),
            ));
        }
        if stride_px > tile_px {
            return Err(GeoError::BadGrid(format!(
                "a stride of {stride_px} px leaves holes between tiles of {tile_px} px"
            )));
        }
        let count = |side_px: u64| match plan {
            // i in {0, ..., (H - Sp) / stride}, equation (1).
            TilePlan::Paper if side_px < tile_px => 0,
            TilePlan::Paper => (side_px - tile_px) / stride_px + 1,
            TilePlan::Clamped => side_px.saturating_sub(tile_px).div_ceil(stride_px) + 1,
        };
        let (columns, rows) = match (count(width_px), count(height_px)) {
            (0, _) | (_, 0) => (0, 0),
            both => both,
        };
        Ok(Self {
            width_px,
            height_px,
            tile_px,
            stride_px,
            plan,
            columns,
            rows,
        })
    }

    /// The paper's plan with its sizes: 512 px tiles, 256 px apart, where they fit.
    ///
    /// # Errors
    /// As [`TileGrid::new`].
    pub fn paper(width_px: u64, height_px: u64) -> Result<Self, GeoError> {
        Self::new(
            width_px,
            height_px,
            Self::TILE_PX,
            Self::STRIDE_PX,
            TilePlan::Paper,
        )
    }

    /// The same sizes, with the last column and row clamped to the edge.
    ///
    /// # Errors
    /// As [`TileGrid::new`].
    pub fn clamped(width_px: u64, height_px: u64) -> Result<Self, GeoError> {
        Self::new(
            width_px,
            height_px,
            Self::TILE_PX,
            Self::STRIDE_PX,
            TilePlan::Clamped,
        )
    }

    /// Width and height of the level, pixels.
    pub fn size_px(&self) -> (u64, u64) {
        (self.width_px, self.height_px)
    }

    /// Side of a tile, pixels.
    pub fn tile_px(&self) -> u64 {
        self.tile_px
    }

    /// Distance between neighbours, pixels (less at a clamped edge).
    pub fn stride_px(&self) -> u64 {
        self.stride_px
    }

    /// The plan.
    pub fn plan(&self) -> TilePlan {
        self.plan
    }

    /// Tiles in a row.
    pub fn columns(&self) -> u64 {
        self.columns
    }

    /// Rows of tiles.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// All tiles.
    pub fn len(&self) -> u64 {
        self.columns * self.rows
    }

    /// Whether there is no tile (the paper's plan on a map smaller than a tile).
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Tile number `index`, row by row from the top left; `None` beyond the last.
    pub fn tile(&self, index: u64) -> Option<Tile> {
        (index < self.len()).then(|| {
            let (row, column) = (index / self.columns, index % self.columns);
            Tile {
                row,
                column,
                x_px: self.origin_px(column, self.width_px),
                y_px: self.origin_px(row, self.height_px),
                side_px: self.tile_px,
            }
        })
    }

    /// All tiles, row by row from the top left.
    pub fn iter(&self) -> impl Iterator<Item = Tile> + '_ {
        (0..self.len()).filter_map(|index| self.tile(index))
    }

    fn origin_px(&self, step: u64, side_px: u64) -> u64 {
        let regular = step * self.stride_px;
        match self.plan {
            TilePlan::Paper => regular,
            TilePlan::Clamped => regular.min(side_px.saturating_sub(self.tile_px)),
        }
    }
}
