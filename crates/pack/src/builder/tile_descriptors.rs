//! Tile descriptors of a level, read back from the journal.

use grimnet_net::normalise;
use grimnet_output::Journal;

use crate::error::{PackError, Result};
use crate::format::TileEntry;

/// Numbers of tile descriptors handled at once: 64 MiB.
const BATCH_FLOATS: usize = 16 << 20;

/// Tile descriptors of a level.
pub struct TileDescriptors<'a> {
    journal: &'a mut Journal,
    tiles: &'a [(TileEntry, u64)],
    dim: usize,
    /// Subtracted from each descriptor.
    mean: Option<Vec<f32>>,
}

impl<'a> TileDescriptors<'a> {
    /// The descriptors, of `dim` numbers, of `tiles` with their offsets in the journal.
    pub fn new(journal: &'a mut Journal, tiles: &'a [(TileEntry, u64)], dim: usize) -> Self {
        Self {
            journal,
            tiles,
            dim,
            mean: None,
        }
    }

    /// Number of tiles.
    pub fn len(&self) -> usize {
        self.tiles.len()
    }

    /// Numbers in a descriptor.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// From now on subtracts the mean of all descriptors from each and makes it a unit vector again. The mean
    /// distinguishes no tile from another, and makes some tiles similar to every photo (hubs; Suzuki et al. 2013,
    /// "Centering similarity measures to reduce hubs"). It is made a little shorter, so that the descriptor of a
    /// single tile does not vanish.
    ///
    /// # Errors
    /// Returns an error if the journal cannot be read.
    pub fn centre(&mut self) -> Result<()> {
        let mut sum = vec![0.0f64; self.dim];
        let dim = self.dim;
        self.for_each_batch(|_, batch| {
            for row in batch.chunks_exact(dim) {
                sum.iter_mut()
                    .zip(row)
                    .for_each(|(s, x)| *s += f64::from(*x));
            }
            Ok(())
        })?;
        let count = self.tiles.len() as f64 + 1.0;
        self.mean = Some(sum.iter().map(|s| (s / count) as f32).collect());
        Ok(())
    }

    fn read(&mut self, tile: usize, into: &mut Vec<f32>) -> Result<()> {
        let mut bytes = Vec::new();
        self.journal
            .read(self.tiles[tile].1, self.dim * size_of::<f32>(), &mut bytes)
            .map_err(PackError::of_journal)?;
        let first = into.len();
        into.extend(
            bytes
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        );
        if let Some(mean) = &self.mean {
            let row = &mut into[first..];
            row.iter_mut().zip(mean).for_each(|(x, m)| *x -= m);
            normalise(row);
        }
        Ok(())
    }

    /// Descriptors of some tiles, one after the other.
    ///
    /// # Errors
    /// Returns an error if the journal cannot be read.
    pub fn read_all(&mut self, tiles: impl IntoIterator<Item = usize>) -> Result<Vec<f32>> {
        let mut rows = Vec::new();
        tiles
            .into_iter()
            .try_for_each(|tile| self.read(tile, &mut rows))?;
        Ok(rows)
    }

    /// Calls `each` with the index of the first tile and the descriptors of each batch of tiles.
    ///
    /// # Errors
    /// Returns an error if the journal cannot be read, and the errors of `each`.
    pub fn for_each_batch(
        &mut self,
        mut each: impl FnMut(usize, &[f32]) -> Result<()>,
    ) -> Result<()> {
        let step = (BATCH_FLOATS / self.dim).max(1);
        for first in (0..self.tiles.len()).step_by(step) {
            let rows = self.read_all(first..self.tiles.len().min(first + step))?;
            each(first, &rows)?;
        }
        Ok(())
    }
}
