//! MBTiles: tiles in an SQLite database.
//!
//! Specification: MBTiles 1.3 (Mapbox). Rows are counted from the south (TMS). Some writers count them from the north and say so
//! (`scheme` `xyz`), but others say so of rows from the south, so it is believed only where the bounds agree.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rusqlite::limits::Limit;
use rusqlite::{Connection, ErrorCode, OpenFlags, OptionalExtension};

use crate::GeoError;
use crate::content_hash::hash_file;
use crate::flipped_rows::bounds_show_flipped_rows;
use crate::tile_address::TileAddress;
use crate::tile_index::{MAX_TILES, TileIndex};
use crate::tile_store::TileStore;
use grimnet_limits::MapLimits;

/// Instructions of SQLite's machine between two looks at the budget.
const STEPS_A_LOOK: i32 = 10_000;
/// Instructions that one query may take, besides one for each byte of the file: a view may never end.
const BASE_STEPS: u64 = 100_000_000;
/// Largest tile, bytes.
const MAX_TILE_BYTES: u64 = MapLimits::DEFAULT.max_tile_bytes;

/// An MBTiles file.
pub(crate) struct MbTiles {
    path: PathBuf,
    connection: Mutex<Connection>,
    index: TileIndex,
    bounds_deg: Option<[f64; 4]>,
    states_rows_from_north: bool,
    /// Whether its bounds show from where rows are counted; looked at only where it states that they are from the north.
    bounds_show_rows: bool,
    rows_from_north: bool,
}

impl MbTiles {
    /// Opens a file and lists its tiles.
    ///
    /// Nothing is written: no journal, no lock, no shared memory (`mode=ro`, `immutable=1`).
    pub fn open(path: &Path) -> Result<Self, GeoError> {
        check_closed(path)?;
        let connection = connect(path)?;
        let mut file = Self {
            path: path.to_path_buf(),
            connection: Mutex::new(connection),
            index: TileIndex::default(),
            bounds_deg: None,
            states_rows_from_north: false,
            bounds_show_rows: false,
            rows_from_north: false,
        };
        file.check_tables()?;
        file.check_metadata()?;
        file.index = file.list()?;
        let bounds = file.bounds_deg.filter(|_| file.states_rows_from_north);
        let shown = bounds.and_then(|bounds_deg| bounds_show_flipped_rows(&file.index, bounds_deg));
        file.bounds_show_rows = shown.is_some();
        if shown == Some(true) {
            file.rows_from_north = true;
            file.index = file.list()?;
        }
        Ok(file)
    }

    /// Refuses other SQLite databases.
    fn check_tables(&self) -> Result<(), GeoError> {
        if self.has_table("tiles")? {
            return Ok(());
        }
        if self.has_table("gpkg_contents")? {
            return Err(GeoError::Unsupported {
                path: self.path.clone(),
                what: "GeoPackage as a map".to_string(),
                advice: "convert it: gdal_translate -of COG -co COMPRESS=JPEG IN.gpkg OUT.tif",
            });
        }
        Err(GeoError::NotAMap {
            path: self.path.clone(),
            reason: "it is an SQLite database without the table 'tiles' of MBTiles".to_string(),
        })
    }

    fn has_table(&self, name: &str) -> Result<bool, GeoError> {
        self.lock()
            .query_row(
                "SELECT 1 FROM sqlite_master WHERE type IN ('table', 'view') AND name = ?1",
                [name],
                |_| Ok(()),
            )
            .optional()
            .map(|found| found.is_some())
            .map_err(|e| self.error(e))
    }

    fn check_metadata(&mut self) -> Result<(), GeoError> {
        let unsupported = |what: String, advice| GeoError::Unsupported {
            path: self.path.clone(),
            what,
            advice,
        };
        if let Some(format) = self.metadata("format")?
            && ["pbf", "mvt", "mlt"].contains(&format.trim().to_ascii_lowercase().as_str())
        {
            return Err(unsupported(
                format!("vector tiles (format '{}')", format.trim()),
                ADVICE_RASTER,
            ));
        }
        for key in ["crs", "srs", "profile"] {
            let Some(grid) = self.metadata(key)? else {
                continue;
            };
            let lower = grid.to_ascii_lowercase();
            let is_mercator = ["3857", "900913", "3785", "mercator"]
                .iter()
                .any(|word| lower.contains(word));
            if !is_mercator && !lower.trim().is_empty() {
                return Err(unsupported(
                    format!("tiles of another grid than Web Mercator ({key} '{grid}')"),
                    ADVICE_MERCATOR,
                ));
            }
        }
        self.bounds_deg = self.metadata("bounds")?.and_then(|text| bounds_of(&text));
        self.states_rows_from_north = self
            .metadata("scheme")?
            .is_some_and(|scheme| scheme.trim().eq_ignore_ascii_case("xyz"));
        Ok(())
    }

    /// A value of the table `metadata`.
    fn metadata(&self, name: &str) -> Result<Option<String>, GeoError> {
        let found = self.lock().query_row(
            "SELECT CAST(value AS TEXT) FROM metadata WHERE name = ?1",
            [name],
            |row| row.get::<_, Option<String>>(0),
        );
        match found.optional() {
            Ok(value) => Ok(value.flatten()),
            // Files without metadata, or with other columns, have pictures all the same.
            Err(
                rusqlite::Error::SqlInputError { .. }
                | rusqlite::Error::FromSqlConversionFailure(..),
            ) => Ok(None),
            Err(rusqlite::Error::SqliteFailure(e, _)) if e.code == ErrorCode::Unknown => Ok(None),
            Err(other) => Err(self.error(other)),
        }
    }

    fn list(&self) -> Result<TileIndex, GeoError> {
        let connection = self.lock();
        let mut index = TileIndex::default();
        let mut statement = connection
            .prepare("SELECT zoom_level, tile_column, tile_row FROM tiles")
            .map_err(|e| self.error(e))?;
        let mut rows = statement.query([]).map_err(|e| self.error(e))?;
        while let Some(row) = rows.next().map_err(|e| self.error(e))? {
            let number = |i: usize| row.get::<_, i64>(i);
            let (zoom, column, row) = match (number(0), number(1), number(2)) {
                (Ok(zoom), Ok(column), Ok(row)) => (zoom, column, row),
                _ => {
                    return Err(GeoError::damaged(
                        &self.path,
                        "zoom, column and row of a tile are not three whole numbers",
                    ));
                }
            };
            let address = [zoom, column, row].map(|v| u64::try_from(v).ok());
            let address = match address {
                [Some(zoom), Some(column), Some(row)] => TileAddress::new(zoom, column, row),
                _ => None,
            }
            .ok_or_else(|| {
                GeoError::damaged(
                    &self.path,
                    format!("zoom {zoom} has no tile at column {column}, row {row}"),
                )
            })?;
            index
                .add(self.as_stored(address))
                .map_err(|_| GeoError::Unsupported {
                    path: self.path.clone(),
                    what: format!("more than {MAX_TILES} tiles"),
                    advice: "cut out a part: gdal_translate -projwin ULX ULY LRX LRY IN OUT.tif",
                })?;
        }
        if let Some(twice) = index.sort() {
            return Err(GeoError::damaged(
                &self.path,
                format!("tile {} is there twice", self.as_stored(twice)),
            ));
        }
        Ok(index)
    }

    /// The address in the table of an address in the XYZ scheme, or back.
    fn as_stored(&self, address: TileAddress) -> TileAddress {
        if self.rows_from_north {
            address
        } else {
            address.flipped()
        }
    }

    fn lock(&self) -> MutexGuard<'_, Connection> {
        // A panic elsewhere leaves the connection as it was: statements are not kept.
        self.connection
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn error(&self, error: rusqlite::Error) -> GeoError {
        sqlite_error(&self.path, &error)
    }
}

impl TileStore for MbTiles {
    fn path(&self) -> &Path {
        &self.path
    }

    fn kind(&self) -> &'static str {
        "MBTiles"
    }

    fn index(&self) -> &TileIndex {
        &self.index
    }

    fn tile(&self, address: TileAddress) -> Result<Option<Vec<u8>>, GeoError> {
        if !self.index.contains(address) {
            return Ok(None);
        }
        let stored = self.as_stored(address);
        let connection = self.lock();
        let mut statement = connection
            .prepare(
                "SELECT tile_data FROM tiles WHERE zoom_level = ?1 AND tile_column = ?2 AND tile_row = ?3",
            )
            .map_err(|e| self.error(e))?;
        let data = statement
            .query_row((stored.zoom, stored.column, stored.row), |row| {
                // Some writers store pictures as text.
                row.get_ref(0)?
                    .as_bytes_or_null()
                    .map(|bytes| bytes.map(<[u8]>::to_vec))
                    .map_err(Into::into)
            })
            .optional();
        match data {
            Ok(bytes) => Ok(bytes.flatten()),
            Err(error) => Err(self.damaged(address, &error.to_string())),
        }
    }

    fn damaged(&self, address: TileAddress, reason: &str) -> GeoError {
        let stored = self.as_stored(address);
        GeoError::damaged(
            &self.path,
            format!(
                "tile with zoom_level {}, tile_column {}, tile_row {}: {reason}",
                stored.zoom, stored.column, stored.row
            ),
        )
    }

    /// The bytes of the file.
    fn hash(&self, _zooms: &[u8], hasher: &mut blake3::Hasher) -> Result<(), GeoError> {
        hash_file(hasher, &self.path).map(|_| ())
    }

    fn stated_bounds_deg(&self) -> Option<[f64; 4]> {
        self.bounds_deg
    }

    fn advice_on_flipped_rows(&self) -> &'static str {
        "if they are counted from the north (XYZ), state it: sqlite3 FILE \"INSERT INTO metadata VALUES ('scheme', 'xyz')\"; else correct \
         the bounds in its metadata"
    }

    fn caveats(&self) -> Vec<String> {
        let is_unchecked = self.states_rows_from_north && !self.bounds_show_rows;
        let caveat = "its metadata says that rows are counted from the north (scheme xyz), and has no bounds that show it; they are \
                      read as counted from the south, as MBTiles has them: check where the map lies";
        is_unchecked
            .then(|| caveat.to_string())
            .into_iter()
            .collect()
    }
}

const ADVICE_RASTER: &str = "expected pictures (PNG, JPEG, WebP): take the raster tiles of the same provider, or the aerial pictures \
                             the map is made of";
const ADVICE_MERCATOR: &str =
    "expected EPSG:3857: convert it: gdalwarp -t_srs EPSG:3857 IN OUT.tif";

/// Refuses a file whose newest changes lie in a journal beside it: they would be missed.
fn check_closed(path: &Path) -> Result<(), GeoError> {
    for ending in ["-wal", "-journal"] {
        let mut journal = path.as_os_str().to_owned();
        journal.push(ending);
        let journal = PathBuf::from(journal);
        if std::fs::metadata(&journal).is_ok_and(|m| m.len() > 0) {
            return Err(GeoError::Unsupported {
                path: path.to_path_buf(),
                what: format!(
                    "it was not closed: {} holds changes that are not in it yet",
                    journal.display()
                ),
                advice: "close the program that writes it, or run: sqlite3 FILE 'PRAGMA journal_mode=DELETE'",
            });
        }
    }
    Ok(())
}

fn connect(path: &Path) -> Result<Connection, GeoError> {
    let error = |e: rusqlite::Error| sqlite_error(path, &e);
    let absolute = std::path::absolute(path).map_err(|e| GeoError::io(path, e))?;
    let uri = format!("file:{}?mode=ro&immutable=1", uri_path(&absolute, path)?);
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
        | OpenFlags::SQLITE_OPEN_URI
        | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let mut connection = Connection::open_with_flags(uri, flags).map_err(error)?;
    let length = i32::try_from(MAX_TILE_BYTES).unwrap_or(i32::MAX);
    connection
        .set_limit(Limit::SQLITE_LIMIT_LENGTH, length)
        .map_err(error)?;
    connection
        .set_limit(Limit::SQLITE_LIMIT_ATTACHED, 0)
        .map_err(error)?;
    // SQL in the file (views, triggers) may not call functions with effects, and may not run for ever.
    connection
        .execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA query_only = ON; PRAGMA temp_store = MEMORY;")
        .map_err(error)?;
    let bytes = std::fs::metadata(path)
        .map_err(|e| GeoError::io(path, e))?
        .len();
    limit_steps(&mut connection, BASE_STEPS.saturating_add(bytes)).map_err(error)?;
    Ok(connection)
}

/// Stops a query after this many instructions.
fn limit_steps(connection: &mut Connection, steps: u64) -> rusqlite::Result<()> {
    let looks = steps / STEPS_A_LOOK as u64;
    let mut left = looks;
    connection.progress_handler(
        STEPS_A_LOOK,
        Some(move || {
            if left == 0 {
                left = looks;
                return true;
            }
            left -= 1;
            false
        }),
    )
}

/// A path as SQLite takes it in a URI.
fn uri_path(absolute: &Path, path: &Path) -> Result<String, GeoError> {
    let text = absolute.to_str().ok_or_else(|| GeoError::Unsupported {
        path: path.to_path_buf(),
        what: "a file name that is not UTF-8".to_string(),
        advice: "rename the file",
    })?;
    let text = text.replace('\\', "/");
    let mut uri = String::with_capacity(text.len() + 1);
    if !text.starts_with('/') {
        // C:/maps/town.mbtiles
        uri.push('/');
    }
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"/-_.~:".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            uri.push_str(&format!("%{byte:02X}"));
        }
    }
    Ok(uri)
}

fn sqlite_error(path: &Path, error: &rusqlite::Error) -> GeoError {
    match error.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => GeoError::NotAMap {
            path: path.to_path_buf(),
            reason: "it begins like an SQLite database and is none".to_string(),
        },
        Some(ErrorCode::OperationInterrupted) => GeoError::damaged(
            path,
            "a query takes more steps than a map of this size can need",
        ),
        _ => GeoError::damaged(path, error),
    }
}

/// `west,south,east,north` in degrees.
fn bounds_of(text: &str) -> Option<[f64; 4]> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|word| word.trim().parse().ok().filter(|v: &f64| v.is_finite()))
        .collect::<Option<_>>()?;
    numbers.try_into().ok()
}
