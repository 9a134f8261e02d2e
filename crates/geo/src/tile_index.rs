//! Which tiles a map has.

use std::collections::BTreeMap;

use grimnet_limits::MapLimits;

use crate::antimeridian::AroundTheWorld;
use crate::tile_address::TileAddress;

/// Maximum number of tiles of all zooms.
pub(crate) const MAX_TILES: u64 = MapLimits::DEFAULT.max_tiles;

/// The tiles of a map, by zoom, sorted.
#[derive(Debug, Default)]
pub(crate) struct TileIndex {
    zooms: BTreeMap<u8, Vec<(u32, u32)>>,
    count: u64,
    sorted: bool,
}

/// There are more tiles than the limit.
#[derive(Debug)]
pub(crate) struct TooManyTiles;

/// Columns and rows of tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TileRange {
    /// Westernmost column.
    pub first_column: u32,
    /// Easternmost column, counted on across the antimeridian: `2^zoom` is the column 0 east of it.
    pub last_column: u32,
    /// Northernmost row.
    pub first_row: u32,
    /// Southernmost row.
    pub last_row: u32,
}

impl TileIndex {
    /// Adds a tile.
    pub fn add(&mut self, address: TileAddress) -> Result<(), TooManyTiles> {
        if self.count >= MAX_TILES {
            return Err(TooManyTiles);
        }
        self.count += 1;
        self.sorted = false;
        let tiles = self.zooms.entry(address.zoom).or_default();
        tiles.push((address.column, address.row));
        Ok(())
    }

    /// Sorts the tiles. Returns one that was added twice, if there is one.
    pub fn sort(&mut self) -> Option<TileAddress> {
        let mut twice = None;
        for (&zoom, tiles) in &mut self.zooms {
            tiles.sort_unstable();
            twice = twice.or_else(|| {
                let pair = tiles.windows(2).find(|pair| pair[0] == pair[1])?;
                let (column, row) = pair[0];
                Some(TileAddress { zoom, column, row })
            });
        }
        self.sorted = true;
        twice
    }

    /// Zooms with tiles, coarsest first.
    pub fn zooms(&self) -> impl DoubleEndedIterator<Item = u8> + '_ {
        self.zooms.keys().copied()
    }

    /// Tiles of a zoom by column and row, sorted.
    pub fn of_zoom(&self, zoom: u8) -> &[(u32, u32)] {
        self.zooms.get(&zoom).map_or(&[], Vec::as_slice)
    }

    /// Whether there is such a tile.
    pub fn contains(&self, address: TileAddress) -> bool {
        debug_assert!(self.sorted);
        self.of_zoom(address.zoom)
            .binary_search(&(address.column, address.row))
            .is_ok()
    }

    /// The tiles' columns and rows.
    pub fn range(&self, zoom: u8) -> Option<TileRange> {
        let tiles = self.of_zoom(zoom);
        let columns = || {
            let runs = tiles.chunk_by(|a, b| a.0 == b.0);
            runs.map(|run| f64::from(run[0].0))
        };
        let edges = columns().map(|column| (column, column + 1.0));
        let around = AroundTheWorld::from_edges(edges, f64::from(1_u32 << zoom));
        let shifted = || columns().map(|column| (column + around.shift(column)) as u32);
        Some(TileRange {
            first_column: shifted().min()?,
            last_column: shifted().max()?,
            first_row: tiles.iter().map(|t| t.1).min()?,
            last_row: tiles.iter().map(|t| t.1).max()?,
        })
    }

    /// Whether each tile of `finer` lies in a tile of the zoom above it.
    pub fn zoom_above_covers(&self, finer: u8) -> bool {
        let Some(zoom) = finer.checked_sub(1) else {
            return false;
        };
        self.of_zoom(finer).iter().all(|&(column, row)| {
            self.contains(TileAddress {
                zoom,
                column: column / 2,
                row: row / 2,
            })
        })
    }

    /// Share of the tiles of `coarser` in which there are tiles of `finer`, `0.0..=1.0`.
    pub fn share_refined(&self, coarser: u8, finer: u8) -> f64 {
        let Some(steps) = finer.checked_sub(coarser) else {
            return 1.0;
        };
        let mut refined: Vec<(u32, u32)> = self
            .of_zoom(finer)
            .iter()
            .map(|&(column, row)| (column >> steps, row >> steps))
            .collect();
        refined.sort_unstable();
        refined.dedup();
        let tiles = self.of_zoom(coarser);
        let both = refined
            .iter()
            .filter(|tile| tiles.binary_search(tile).is_ok())
            .count();
        both as f64 / tiles.len().max(1) as f64
    }
}
