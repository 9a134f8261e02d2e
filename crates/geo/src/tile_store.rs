//! Where the tiles of a map come from.

use std::path::{Path, PathBuf};

use crate::GeoError;
use crate::tile_address::TileAddress;
use crate::tile_index::TileIndex;

/// Compressed pictures of the Web Mercator grid: a folder, an MBTiles or a PMTiles file.
pub(crate) trait TileStore: Send + Sync {
    /// The file or folder.
    fn path(&self) -> &Path;

    /// The files that it is read from; a folder stands for all files below it.
    fn files(&self) -> Vec<PathBuf> {
        vec![self.path().to_path_buf()]
    }

    /// Name of the format.
    fn kind(&self) -> &'static str;

    /// Which tiles there are.
    fn index(&self) -> &TileIndex;

    /// A tile as it is stored; `None` if there is none.
    fn tile(&self, address: TileAddress) -> Result<Option<Vec<u8>>, GeoError>;

    /// An error about a tile.
    fn damaged(&self, address: TileAddress, reason: &str) -> GeoError {
        GeoError::damaged(self.path(), format!("tile {address}: {reason}"))
    }

    /// Adds everything that the tiles of these zooms are made of to a hash.
    fn hash(&self, zooms: &[u8], hasher: &mut blake3::Hasher) -> Result<(), GeoError>;

    /// West, south, east and north as the store states them, degrees.
    fn stated_bounds_deg(&self) -> Option<[f64; 4]> {
        None
    }

    /// What to do about rows that are counted from the other side.
    fn advice_on_flipped_rows(&self) -> &'static str {
        "make the tiles again"
    }

    /// What may be wrong with it, a sentence each.
    fn caveats(&self) -> Vec<String> {
        Vec::new()
    }
}
