//! The features of a level: in memory or mapped, and verified before use.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use memmap2::Mmap;
use rayon::prelude::*;

use crate::error::{PackError, Result};
use crate::file::{AlignedBytes, PackFile};
use crate::format::BLOCK_LEN;
use crate::manifest::Section;
use grimnet_limits::PackLimits;

/// Length of a block hash, bytes.
const HASH_LEN: usize = blake3::OUT_LEN;

/// The features section of a level.
#[derive(Debug)]
pub(crate) enum FeatureStore {
    /// Copied and verified.
    Copied(AlignedBytes),
    /// In the mapped file.
    Mapped(MappedFeatures),
}

impl FeatureStore {
    /// Takes the section from the file as the limits say. `block_hashes` are verified.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or a block that is verified now is damaged.
    pub fn open(
        file: &Arc<PackFile>,
        map: Option<&Arc<Mmap>>,
        section: &Section,
        block_hashes: AlignedBytes,
        limits: &PackLimits,
    ) -> Result<Self> {
        let Some(map) = map.filter(|_| section.len > limits.copy_features_bytes) else {
            let bytes = file.copy(section.offset, section.len)?;
            check_blocks(file, section, 0, bytes.as_slice(), block_hashes.as_slice())?;
            return Ok(Self::Copied(bytes));
        };
        let blocks = section.len.div_ceil(BLOCK_LEN) as usize;
        let features = MappedFeatures {
            file: Arc::clone(file),
            map: Arc::clone(map),
            section: section.clone(),
            block_hashes,
            verified: (0..blocks).map(|_| AtomicBool::new(false)).collect(),
            modified: Mutex::new(file.modified()),
        };
        if section.len <= limits.verify_at_open_bytes {
            features.verify_all()?;
        }
        Ok(Self::Mapped(features))
    }

    /// Some bytes of the section, verified.
    ///
    /// # Errors
    /// Returns [`PackError::Corrupt`] if a block is damaged, [`PackError::Changed`] if the file was changed.
    pub fn get(&self, range: Range<usize>) -> Result<&[u8]> {
        match self {
            Self::Copied(bytes) => Ok(bytes.as_slice().get(range).unwrap_or_default()),
            Self::Mapped(features) => features.get(range),
        }
    }
}

/// Features that stay in the file.
#[derive(Debug)]
pub(crate) struct MappedFeatures {
    file: Arc<PackFile>,
    map: Arc<Mmap>,
    section: Section,
    block_hashes: AlignedBytes,
    /// Which blocks were verified since the file was last modified.
    verified: Box<[AtomicBool]>,
    /// When that was. Each level keeps its own: all of them have to verify again.
    modified: Mutex<Option<SystemTime>>,
}

impl MappedFeatures {
    fn get(&self, range: Range<usize>) -> Result<&[u8]> {
        if range.is_empty() {
            return Ok(&[]);
        }
        let block = BLOCK_LEN as usize;
        self.verify(range.start / block..range.end.div_ceil(block))?;
        let start = self.section.offset as usize;
        Ok(self
            .map
            .get(start + range.start..start + range.end)
            .unwrap_or_default())
    }

    /// Verifies those of some blocks that are not yet verified.
    fn verify(&self, blocks: Range<usize>) -> Result<()> {
        let modified = self.file.check_unchanged()?;
        {
            let mut known = self.modified.lock().unwrap_or_else(PoisonError::into_inner);
            if *known != modified {
                self.verified
                    .iter()
                    .for_each(|v| v.store(false, Ordering::Relaxed));
                *known = modified;
            }
        }
        blocks.into_iter().try_for_each(|i| self.verify_block(i))
    }

    /// Verifies all blocks from the file, without the mapping.
    fn verify_all(&self) -> Result<()> {
        self.verified
            .par_iter()
            .enumerate()
            .try_for_each(|(i, verified)| {
                let (offset, len) = self.place(i);
                let bytes = self.file.copy(offset, len)?;
                self.check(i, bytes.as_slice())?;
                verified.store(true, Ordering::Relaxed);
                Ok(())
            })
    }

    /// Offset and length of a block in the file.
    fn place(&self, i: usize) -> (u64, u64) {
        let first = i as u64 * BLOCK_LEN;
        let len = BLOCK_LEN.min(self.section.len - first);
        (self.section.offset + first, len)
    }

    fn check(&self, i: usize, bytes: &[u8]) -> Result<()> {
        let hashes = self.block_hashes.as_slice();
        check_block(&self.file, &self.section, i, bytes, hashes)
    }

    fn verify_block(&self, i: usize) -> Result<()> {
        let Some(verified) = self.verified.get(i) else {
            return Ok(());
        };
        if verified.load(Ordering::Relaxed) {
            return Ok(());
        }
        let (offset, len) = self.place(i);
        let range = offset as usize..(offset + len) as usize;
        self.check(i, self.map.get(range).unwrap_or_default())?;
        verified.store(true, Ordering::Relaxed);
        Ok(())
    }
}

/// Compares the blocks of a section from block `first` on with their hashes; `hashes` are those of all blocks.
pub(crate) fn check_blocks(
    file: &PackFile,
    section: &Section,
    first: usize,
    bytes: &[u8],
    hashes: &[u8],
) -> Result<()> {
    bytes
        .par_chunks(BLOCK_LEN as usize)
        .enumerate()
        .try_for_each(|(i, block)| check_block(file, section, first + i, block, hashes))
}

/// Compares block `i` of a section with its hash.
fn check_block(
    file: &PackFile,
    section: &Section,
    i: usize,
    bytes: &[u8],
    hashes: &[u8],
) -> Result<()> {
    let expected = hashes.get(i * HASH_LEN..(i + 1) * HASH_LEN);
    if expected == Some(blake3::hash(bytes).as_bytes()) {
        return Ok(());
    }
    Err(PackError::corrupt(
        file.path(),
        format!(
            "section {}: checksum of the block at byte {} differs",
            section.name.escape_debug(),
            section.offset + i as u64 * BLOCK_LEN
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damaged_block_is_named_by_its_place_in_the_file() {
        const OFFSET: u64 = 64;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("area.grim");
        std::fs::write(&path, []).unwrap();
        let file = PackFile::open(&path).unwrap();
        let mut bytes = vec![7; 2 * BLOCK_LEN as usize + 100];
        let section = Section {
            name: "0/features".into(),
            offset: OFFSET,
            len: bytes.len() as u64,
            blake3: String::new(),
            block_len: Some(BLOCK_LEN),
        };
        let hashes: Vec<u8> = bytes
            .chunks(BLOCK_LEN as usize)
            .flat_map(|block| *blake3::hash(block).as_bytes())
            .collect();
        let last = 2 * BLOCK_LEN as usize;
        check_blocks(&file, &section, 0, &bytes, &hashes).unwrap();
        check_blocks(&file, &section, 2, &bytes[last..], &hashes).unwrap();
        bytes[last + 5] ^= 1;
        for (first, start) in [(0, 0), (1, BLOCK_LEN as usize), (2, last)] {
            let error = check_blocks(&file, &section, first, &bytes[start..], &hashes);
            let error = error.unwrap_err().to_string();
            let place = format!("block at byte {} differs", OFFSET + 2 * BLOCK_LEN);
            assert!(error.contains(&place), "{error}");
        }
    }
}
