//! How much of a level is finished.

use grimnet_output::RecordPlace;

use crate::builder::frontier::Frontier;
use crate::builder::level_plan::Item;
use crate::builder::record::Record;
use crate::format::TileEntry;

/// How much of a level is finished.
#[derive(Debug, Default)]
pub struct LevelState {
    /// Finished items and where their records lie in the journal.
    pub items: Vec<(Item, RecordPlace)>,
    /// Tiles with a descriptor and where it lies in the journal, bytes.
    pub tiles: Vec<(TileEntry, u64)>,
    /// Cells that remaining tiles need.
    pub frontier: Frontier,
    /// Adapted statistics and the number of tiles they come from.
    pub statistics: Option<(Vec<u8>, u32)>,
    /// Tiles of the grid that are complete, skipped ones included.
    pub tiles_done: u64,
}

impl LevelState {
    /// Adds a record that lies in the journal.
    pub fn add(&mut self, item: Item, place: RecordPlace, record: &Record) {
        let dim = record
            .globals
            .len()
            .checked_div(record.tiles.len())
            .unwrap_or(0);
        let first = place.offset + record.globals_offset();
        let offset = |i: usize| first + (i * dim * size_of::<f32>()) as u64;
        let tiles = record.tiles.iter().enumerate();
        self.tiles.extend(tiles.map(|(i, tile)| (*tile, offset(i))));
        self.items.push((item, place));
    }
}
