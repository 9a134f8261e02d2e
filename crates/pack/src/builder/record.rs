//! A finished item as bytes of the journal.
//!
//! ```text
//! 8 x u32      level, units, tiles, floats a tile descriptor, kept sums, floats a sum, zero, zero
//! units x      UnitHead
//! tiles x      TileEntry
//! tiles x      descriptor, f32
//! kept sums x  u32 unit in the item
//! kept sums x  sum, f32
//! units x      feature blob
//! ```

use bytemuck::{Pod, Zeroable};

use crate::format::TileEntry;

/// Counts and state of one unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct UnitHead {
    /// A [`crate::format::UnitState`] as number.
    pub state: u32,
    /// Keypoints in the blob.
    pub keypoints: u32,
    /// Usable pixels.
    pub usable_px: u32,
    /// Pixels inside the map.
    pub inside_px: u32,
    /// Bytes of the blob.
    pub blob_len: u64,
}

/// A finished item.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Level it belongs to.
    pub level: u32,
    /// Units of the item, row by row.
    pub units: Vec<UnitHead>,
    /// Tiles whose descriptor is complete with this item.
    pub tiles: Vec<TileEntry>,
    /// Their descriptors, one after the other.
    pub globals: Vec<f32>,
    /// Units (index in the item) whose VLAD sum later items need.
    pub kept: Vec<u32>,
    /// Those sums, one after the other.
    pub sums: Vec<f32>,
    /// Feature blobs of all units, one after the other.
    pub blobs: Vec<u8>,
}

const HEAD_LEN: usize = 32;

impl Record {
    /// As bytes.
    pub fn to_bytes(&self) -> Vec<u8> {
        let per = |all: usize, count: usize| all.checked_div(count).unwrap_or(0) as u32;
        let head: [u32; 8] = [
            self.level,
            self.units.len() as u32,
            self.tiles.len() as u32,
            per(self.globals.len(), self.tiles.len()),
            self.kept.len() as u32,
            per(self.sums.len(), self.kept.len()),
            0,
            0,
        ];
        [
            bytemuck::cast_slice(&head),
            bytemuck::cast_slice(&self.units),
            bytemuck::cast_slice(&self.tiles),
            bytemuck::cast_slice(&self.globals),
            bytemuck::cast_slice(&self.kept),
            bytemuck::cast_slice(&self.sums),
            &self.blobs,
        ]
        .concat()
    }

    /// From [`Record::to_bytes`]; `None` if lengths do not fit.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (head, mut rest) = bytes.split_at_checked(HEAD_LEN)?;
        let head: [u32; 8] = bytemuck::pod_read_unaligned(head);
        let [level, units, tiles, global_dim, kept, sum_len] =
            [0, 1, 2, 3, 4, 5].map(|i| head[i] as usize);
        let record = Self {
            level: level as u32,
            units: take(&mut rest, units)?,
            tiles: take(&mut rest, tiles)?,
            globals: take(&mut rest, tiles.checked_mul(global_dim)?)?,
            kept: take(&mut rest, kept)?,
            sums: take(&mut rest, kept.checked_mul(sum_len)?)?,
            blobs: rest.to_vec(),
        };
        let blob_len = record
            .units
            .iter()
            .try_fold(0u64, |sum, unit| sum.checked_add(unit.blob_len))?;
        (blob_len == rest.len() as u64).then_some(record)
    }

    /// Offset of the tile descriptors in the bytes.
    pub fn globals_offset(&self) -> u64 {
        (HEAD_LEN
            + self.units.len() * size_of::<UnitHead>()
            + self.tiles.len() * size_of::<TileEntry>()) as u64
    }
}

/// Takes `count` numbers from the front.
fn take<T: Pod>(bytes: &mut &[u8], count: usize) -> Option<Vec<T>> {
    let (front, rest) = bytes.split_at_checked(count.checked_mul(size_of::<T>())?)?;
    *bytes = rest;
    Some(bytemuck::pod_collect_to_vec(front))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip() {
        let record = Record {
            level: 2,
            units: vec![
                UnitHead {
                    state: 1,
                    keypoints: 3,
                    usable_px: 9,
                    inside_px: 10,
                    blob_len: 5,
                },
                UnitHead::default(),
            ],
            tiles: vec![TileEntry { column: 7, row: 8 }],
            globals: vec![0.5, 0.25],
            kept: vec![1],
            sums: vec![1.0, 2.0, 3.0],
            blobs: vec![1, 2, 3, 4, 5],
        };
        let bytes = record.to_bytes();
        assert_eq!(Record::from_bytes(&bytes), Some(record.clone()));
        let at = record.globals_offset() as usize;
        assert_eq!(bytes[at..at + 4], 0.5f32.to_le_bytes());
        for cut in 0..bytes.len() {
            assert_eq!(Record::from_bytes(&bytes[..cut]), None);
        }
    }
}
