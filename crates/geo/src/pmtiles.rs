//! PMTiles: tiles in one file with a directory.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use flate2::read::GzDecoder;
use grimnet_limits::MapLimits;

use crate::GeoError;
use crate::content_hash::hash_file;
use crate::hilbert::{number_of_tile, tile_of_number};
use crate::pmtiles_directory::{
    COMPRESSION_GZIP, Problem, Run, read_header, read_runs, read_section,
};
use crate::tile_address::TileAddress;
use crate::tile_index::{MAX_TILES, TileIndex};
use crate::tile_store::TileStore;

/// Largest tile, bytes.
const MAX_TILE_BYTES: u64 = MapLimits::DEFAULT.max_tile_bytes;
/// Types of tiles (PMTiles v3, section 3): unknown, MVT, PNG, JPEG, WebP, AVIF, MLT.
const TYPE_UNKNOWN: u8 = 0;
const TYPE_PICTURES: std::ops::RangeInclusive<u8> = 2..=4;
const TYPE_AVIF: u8 = 5;
/// Compressions of tiles besides gzip: unknown, none.
const COMPRESSIONS_PLAIN: std::ops::RangeInclusive<u8> = 0..=1;

/// A PMTiles file.
pub(crate) struct PmTiles {
    path: PathBuf,
    file: Mutex<File>,
    index: TileIndex,
    runs: Vec<Run>,
    gzip: bool,
    bounds_deg: [f64; 4],
}

impl PmTiles {
    /// Opens a file and reads its directories.
    pub fn open(path: &Path) -> Result<Self, GeoError> {
        let error = |problem| map_error(path, problem);
        let mut file = File::open(path).map_err(|e| GeoError::io(path, e))?;
        let header = read_header(&mut file).map_err(error)?;
        let unsupported = |what: String, advice| GeoError::Unsupported {
            path: path.to_path_buf(),
            what,
            advice,
        };
        match header.tile_type {
            TYPE_UNKNOWN => {}
            kind if TYPE_PICTURES.contains(&kind) => {}
            TYPE_AVIF => {
                return Err(unsupported(
                    "AVIF tiles".to_string(),
                    "expected PNG, JPEG or WebP: convert it: gdal_translate -of COG -co COMPRESS=JPEG IN OUT.tif",
                ));
            }
            other => {
                return Err(unsupported(
                    format!("vector tiles (tile type {other})"),
                    "expected pictures (PNG, JPEG, WebP): take raster tiles, or the aerial pictures the map is made of",
                ));
            }
        }
        let gzip = header.tile_compression == COMPRESSION_GZIP;
        if !gzip && !COMPRESSIONS_PLAIN.contains(&header.tile_compression) {
            return Err(unsupported(
                format!("tiles with compression {}", header.tile_compression),
                "expected gzip or none: convert it with pmtiles convert",
            ));
        }
        let runs = read_runs(&mut file, &header, MAX_TILES).map_err(error)?;
        let index = list(path, &runs)?;
        Ok(Self {
            path: path.to_path_buf(),
            file: Mutex::new(file),
            index,
            runs,
            gzip,
            bounds_deg: header.bounds_deg,
        })
    }
}

fn list(path: &Path, runs: &[Run]) -> Result<TileIndex, GeoError> {
    let mut index = TileIndex::default();
    for run in runs {
        if run.data.length > MAX_TILE_BYTES {
            return Err(GeoError::damaged(
                path,
                format!("a tile of {} bytes", run.data.length),
            ));
        }
        for number in run.first..run.first + u64::from(run.count) {
            let address = tile_of_number(number).ok_or_else(|| {
                GeoError::damaged(path, format!("tile number {number} is beyond the grid"))
            })?;
            index
                .add(address)
                .map_err(|_| GeoError::damaged(path, format!("more than {MAX_TILES} tiles")))?;
        }
    }
    // Numbers are in order, so that no tile is there twice.
    index.sort();
    Ok(index)
}

impl TileStore for PmTiles {
    fn path(&self) -> &Path {
        &self.path
    }

    fn kind(&self) -> &'static str {
        "PMTiles"
    }

    fn index(&self) -> &TileIndex {
        &self.index
    }

    fn tile(&self, address: TileAddress) -> Result<Option<Vec<u8>>, GeoError> {
        let number = number_of_tile(address);
        let after = self.runs.partition_point(|run| run.first <= number);
        let Some(run) = after.checked_sub(1).map(|i| self.runs[i]) else {
            return Ok(None);
        };
        if number - run.first >= u64::from(run.count) {
            return Ok(None);
        }
        let stored = {
            let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
            read_section(&mut file, run.data).map_err(|e| map_error(&self.path, e))?
        };
        if !self.gzip {
            return Ok(Some(stored));
        }
        let mut bytes = Vec::new();
        GzDecoder::new(stored.as_slice())
            .take(MAX_TILE_BYTES + 1)
            .read_to_end(&mut bytes)
            .map_err(|e| self.damaged(address, &format!("it cannot be decompressed: {e}")))?;
        if bytes.len() as u64 > MAX_TILE_BYTES {
            return Err(self.damaged(address, "it is too large when decompressed"));
        }
        Ok(Some(bytes))
    }

    /// The bytes of the file.
    fn hash(&self, _zooms: &[u8], hasher: &mut blake3::Hasher) -> Result<(), GeoError> {
        hash_file(hasher, &self.path).map(|_| ())
    }

    fn stated_bounds_deg(&self) -> Option<[f64; 4]> {
        Some(self.bounds_deg)
    }

    fn advice_on_flipped_rows(&self) -> &'static str {
        "make it again of tiles whose rows are counted from the north, as PMTiles has them, or correct its bounds"
    }
}

fn map_error(path: &Path, problem: Problem) -> GeoError {
    match problem {
        Problem::Io(source) => GeoError::io(path, source),
        Problem::Damaged(reason) => GeoError::damaged(path, reason),
        Problem::Truncated { needed_bytes } => GeoError::Truncated {
            path: path.to_path_buf(),
            needed_bytes,
            found_bytes: std::fs::metadata(path).map_or(0, |m| m.len()),
        },
        Problem::Unsupported(what, advice) => GeoError::Unsupported {
            path: path.to_path_buf(),
            what,
            advice,
        },
    }
}
