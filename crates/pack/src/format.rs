//! The bytes of a pack: one little-endian file.
//!
//! ```text
//! offset 0    header, 64 bytes: magic, version, manifest offset and length, blake3 of the manifest
//! offset 64   sections, each starting at a multiple of 64 bytes, in the order of the manifest
//! at the end  the manifest (JSON); the file ends with it
//! ```
//! The manifest lists each section with name, offset, length and blake3. Sections of level `L`:
//!
//! | section | content |
//! |---|---|
//! | `L/features` | blobs, each at a multiple of 64: descriptors `i8 [n][dim]` (paper mode: `f32 [n][dim]`), padding to 4, positions `u16 [n][2]`, scores `f16 [n]` |
//! | `L/features.blocks` | blake3 of each block of [`BLOCK_LEN`] bytes of the features, 32 bytes each |
//! | `L/units` | one [`UnitEntry`] per feature unit (cell or paper tile), row by row |
//! | `L/tiles` | one [`TileEntry`] per tile that has a descriptor, row by row |
//! | `L/globals` | `i8 [tiles][global_dim]`, unit rows, the mean of the level subtracted; paper mode: `f32 [tiles][global_dim]`, nothing subtracted |
//! | `L/global_scales` | `f32 [tiles]`, the int8 quantisation scale of each row; paper mode: empty |
//! | `L/statistics` | adapted normalisation statistics, if any |
//! | `L/ivf.*` | the IVF-PQ index, if any |
//! | `L/keypoints.*` | the index of the keypoints, if any: `centroids` `f32 [lists][dim]`, `list_starts` `u32 [lists + 1]`, `positions` `u16 [n][2]` (steps of 8 px from the corner of the units), `codes` `u64 [n][words]` |
//!
//! Checksums form a tree: header, manifest, sections, and for features their blocks, so that a part of the features can
//! be verified without reading the rest.

use bytemuck::{Pod, Zeroable};

/// First bytes of every pack.
pub const MAGIC: [u8; 8] = *b"GRIMPACK";

/// Version of the layout described above; another version is refused.
pub const FORMAT_VERSION: u32 = 4;

/// Length of the blocks in which features are hashed, bytes; the last one may be shorter.
pub const BLOCK_LEN: u64 = 1 << 20;

/// Maximum length of the manifest, bytes.
pub(crate) const MAX_MANIFEST_LEN: u64 = 16 << 20;

/// Name of the section that holds the block hashes of a section.
pub(crate) fn blocks_name(section: &str) -> String {
    format!("{section}.blocks")
}

/// Sections and feature blobs start at multiples of this many bytes (a cache line).
pub const ALIGNMENT: u64 = 64;

/// Positions are stored as multiples of 1/32 pixel: 2047 px fit into 16 bits.
pub const POSITION_STEPS_PER_PX: f32 = 32.0;

/// First 64 bytes of the file.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: [u8; 8],
    /// [`FORMAT_VERSION`].
    pub version: u32,
    /// Zero.
    pub reserved: u32,
    /// Where the manifest starts, bytes.
    pub manifest_offset: u64,
    /// Its length, bytes; the file ends with it.
    pub manifest_len: u64,
    /// blake3 of the manifest.
    pub manifest_blake3: [u8; 32],
}

/// Bytes of [`Header`].
pub const HEADER_LEN: u64 = size_of::<Header>() as u64;

/// Features of one cell or paper tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct UnitEntry {
    /// Start of the blob in the features section, bytes.
    pub offset: u64,
    /// Keypoints in the blob.
    pub keypoints: u32,
    /// A [`UnitState`] as number.
    pub state: u32,
}

/// Whether a cell or paper tile was computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum UnitState {
    /// Too little of it has data that is not black; nothing is computed.
    Skipped = 0,
    /// Computed; it may have no keypoints.
    Computed = 1,
}

/// One tile that has a descriptor: its place in the tile grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TileEntry {
    /// Column of the tile grid, also the column of its top-left cell.
    pub column: u32,
    /// Row of the tile grid.
    pub row: u32,
}

/// Where the parts of a feature blob of `n` keypoints lie, in bytes from its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlobLayout {
    /// Start of the positions; descriptors lie before.
    pub positions: usize,
    /// Start of the scores.
    pub scores: usize,
    /// Bytes used.
    pub end: usize,
}

impl BlobLayout {
    /// Layout for `keypoints` keypoints with descriptors of `descriptor_len` bytes. `None` if it does not fit into memory.
    pub fn new(keypoints: usize, descriptor_len: usize) -> Option<Self> {
        let positions = keypoints
            .checked_mul(descriptor_len)?
            .checked_next_multiple_of(4)?;
        let scores = positions.checked_add(keypoints.checked_mul(4)?)?;
        let end = scores.checked_add(keypoints.checked_mul(2)?)?;
        // The padding must fit as well.
        end.checked_next_multiple_of(ALIGNMENT as usize)?;
        Some(Self {
            positions,
            scores,
            end,
        })
    }

    /// Bytes that the blob takes in the file, padding included.
    pub fn stored_len(&self) -> usize {
        self.end.next_multiple_of(ALIGNMENT as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_is_one_line() {
        assert_eq!(HEADER_LEN, 64);
    }

    #[test]
    fn blob_of_a_full_cell() {
        let layout = BlobLayout::new(256, 128).unwrap();
        assert_eq!(
            layout,
            BlobLayout {
                positions: 32768,
                scores: 33792,
                end: 34304
            }
        );
        assert_eq!(layout.stored_len(), 34304);
        assert_eq!(BlobLayout::new(usize::MAX / 2, 128), None);
        assert_eq!(
            BlobLayout::new(1, 3).unwrap(),
            BlobLayout {
                positions: 4,
                scores: 8,
                end: 10
            }
        );
    }
}
