//! What the build of a level leaves in the journal, read again to assemble the pack.

use grimnet_output::{Journal, RecordPlace};

use crate::builder::level_plan::{Item, LevelPlan};
use crate::builder::record::{Record, UnitHead};
use crate::error::{PackError, Result};
use crate::format::TileEntry;

/// A level whose items are all in the journal.
#[derive(Debug)]
pub struct FinishedLevel {
    pub plan: LevelPlan,
    /// Items and where their records lie, in order.
    pub items: Vec<(Item, RecordPlace)>,
    /// Tiles with a descriptor and where it lies in the journal, in any order.
    pub tiles: Vec<(TileEntry, u64)>,
    pub keypoints_per_unit: u32,
    /// Adapted statistics and the number of tiles they come from.
    pub statistics: Option<(Vec<u8>, u32)>,
}

impl FinishedLevel {
    /// Calls `each` with column and row, counts and feature blob of each unit that is in the journal.
    ///
    /// # Errors
    /// Returns an error if the journal cannot be read, or the one that `each` returns.
    pub fn for_each_unit(
        &self,
        journal: &mut Journal,
        mut each: impl FnMut([u32; 2], &UnitHead, &[u8]) -> Result<()>,
    ) -> Result<()> {
        let mut bytes = Vec::new();
        for (item, place) in &self.items {
            journal
                .read(place.offset, place.len as usize, &mut bytes)
                .map_err(PackError::of_journal)?;
            let record = Record::from_bytes(&bytes).ok_or_else(|| {
                PackError::Options("the journal changed while it was read".into())
            })?;
            let mut blobs = record.blobs.as_slice();
            for (i, head) in record.units.iter().enumerate() {
                let (blob, rest) = blobs
                    .split_at_checked(head.blob_len as usize)
                    .unwrap_or((&[], &[]));
                blobs = rest;
                let at = [i as u32 % item.count[0], i as u32 / item.count[0]];
                each([item.first[0] + at[0], item.first[1] + at[1]], head, blob)?;
            }
        }
        Ok(())
    }
}
