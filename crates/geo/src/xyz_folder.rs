//! A folder of tiles, `{zoom}/{column}/{row}.png`.

use std::ffi::OsStr;
use std::fs::DirEntry;
use std::path::{Path, PathBuf};

use grimnet_limits::MapLimits;

use crate::GeoError;
use crate::tile_address::TileAddress;
use crate::tile_index::{MAX_TILES, TileIndex};
use crate::tile_store::TileStore;

/// What follows the row in the name of a tile, in small or capital letters.
const ENDINGS: [&str; 8] = [
    ".png", ".jpg", ".jpeg", ".webp", "@2x.png", "@2x.jpg", "@2x.jpeg", "@2x.webp",
];
/// gdal2tiles writes it beside tiles whose rows are counted from the south (TMS).
const TMS_DESCRIPTION: &str = "tilemapresource.xml";
/// Largest description that is read, bytes.
const MAX_DESCRIPTION_BYTES: u64 = 1 << 20;
/// Largest tile, bytes.
const MAX_TILE_BYTES: u64 = MapLimits::DEFAULT.max_tile_bytes;

/// A folder of tiles. Links are followed; other files are left alone.
pub(crate) struct XyzFolder {
    path: PathBuf,
    index: TileIndex,
    /// Endings that occur, as they are spelled.
    endings: Vec<String>,
    rows_from_south: bool,
}

/// Whether a folder holds a tile. Folders that are named by numbers may be years as well as zooms.
pub(crate) fn is_tile_folder(path: &Path) -> Result<bool, GeoError> {
    for zoom in numbered(path)? {
        for column in numbered(&zoom.path)? {
            let is_tile =
                |entry: &DirEntry| entry.file_name().to_str().and_then(tile_name).is_some();
            if entries(&column.path)?.iter().any(is_tile) {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

impl XyzFolder {
    /// Lists a folder; no tile is read.
    pub fn open(path: &Path) -> Result<Self, GeoError> {
        let mut folder = Self {
            path: path.to_path_buf(),
            index: TileIndex::default(),
            endings: Vec::new(),
            rows_from_south: rows_from_south(path)?,
        };
        for zoom in numbered(path)? {
            for column in numbered(&zoom.path)? {
                folder.add_column(zoom.number, &column)?;
            }
        }
        if let Some(address) = folder.index.sort() {
            return Err(folder.damaged(
                folder.as_stored(address),
                "there are two pictures of this tile; delete one",
            ));
        }
        Ok(folder)
    }

    fn add_column(&mut self, zoom: u64, column: &Numbered) -> Result<(), GeoError> {
        for entry in entries(&column.path)? {
            let name = entry.file_name();
            let Some((row, ending)) = name.to_str().and_then(tile_name) else {
                continue;
            };
            if !is_file(&entry) {
                continue;
            }
            let address = TileAddress::new(zoom, column.number, row).ok_or_else(|| {
                GeoError::damaged(
                    &entry.path(),
                    format!(
                        "zoom {zoom} has no tile at column {}, row {row}",
                        column.number
                    ),
                )
            })?;
            if !self.endings.iter().any(|known| known == ending) {
                self.endings.push(ending.to_string());
            }
            let address = self.as_stored(address);
            self.index.add(address).map_err(|_| GeoError::Unsupported {
                path: self.path.clone(),
                what: format!("more than {MAX_TILES} tiles"),
                advice: "take a part of the area, or coarser zooms only",
            })?;
        }
        Ok(())
    }

    /// The address in the names of files of an address in the XYZ scheme, or back.
    fn as_stored(&self, address: TileAddress) -> TileAddress {
        if self.rows_from_south {
            address.flipped()
        } else {
            address
        }
    }

    fn read(&self, address: TileAddress) -> Result<Option<(PathBuf, Vec<u8>)>, GeoError> {
        let stored = self.as_stored(address);
        let column = self
            .path
            .join(stored.zoom.to_string())
            .join(stored.column.to_string());
        for ending in &self.endings {
            let path = column.join(format!("{}{ending}", stored.row));
            match std::fs::metadata(&path) {
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => continue,
                Err(e) => return Err(GeoError::io(&path, e)),
                Ok(metadata) if !metadata.is_file() => continue,
                Ok(metadata) if metadata.len() > MAX_TILE_BYTES => {
                    return Err(GeoError::damaged(
                        &path,
                        format!("a tile of {} bytes", metadata.len()),
                    ));
                }
                Ok(_) => {}
            }
            let bytes = std::fs::read(&path).map_err(|e| GeoError::io(&path, e))?;
            return Ok(Some((path, bytes)));
        }
        Ok(None)
    }
}

impl TileStore for XyzFolder {
    fn path(&self) -> &Path {
        &self.path
    }

    fn files(&self) -> Vec<PathBuf> {
        // Not the folder itself: a pack may be built into it.
        let zooms = numbered(&self.path).unwrap_or_default();
        let description = self.path.join(TMS_DESCRIPTION);
        zooms
            .into_iter()
            .map(|zoom| zoom.path)
            .chain([description])
            .collect()
    }

    fn kind(&self) -> &'static str {
        if self.rows_from_south {
            "folder of tiles (TMS)"
        } else {
            "folder of tiles (XYZ)"
        }
    }

    fn index(&self) -> &TileIndex {
        &self.index
    }

    fn tile(&self, address: TileAddress) -> Result<Option<Vec<u8>>, GeoError> {
        if !self.index.contains(address) {
            return Ok(None);
        }
        Ok(self.read(address)?.map(|(_, bytes)| bytes))
    }

    fn damaged(&self, address: TileAddress, reason: &str) -> GeoError {
        let stored = self.as_stored(address);
        let name = format!("{}/{}/{}", stored.zoom, stored.column, stored.row);
        GeoError::damaged(&self.path, format!("tile {name}: {reason}"))
    }

    /// Places and bytes of all tiles of these zooms, in order of zoom, column and row.
    fn hash(&self, zooms: &[u8], hasher: &mut blake3::Hasher) -> Result<(), GeoError> {
        for &zoom in zooms {
            for &(column, row) in self.index.of_zoom(zoom) {
                let address = TileAddress { zoom, column, row };
                let (path, bytes) = self
                    .read(address)?
                    .ok_or_else(|| self.damaged(address, "it was deleted meanwhile"))?;
                if image::guess_format(&bytes).is_err() {
                    // Found here, before any work starts: all tiles are read anyway.
                    return Err(GeoError::damaged(
                        &path,
                        "it is not a picture (an error page that was saved as a tile?)",
                    ));
                }
                hasher.update(&[zoom]);
                hasher.update(&column.to_le_bytes());
                hasher.update(&row.to_le_bytes());
                hasher.update(&(bytes.len() as u64).to_le_bytes());
                hasher.update(&bytes);
            }
        }
        Ok(())
    }
}

/// A folder that is named by a number.
struct Numbered {
    number: u64,
    path: PathBuf,
}

/// Folders in a folder that are named by numbers.
fn numbered(path: &Path) -> Result<Vec<Numbered>, GeoError> {
    let mut found = Vec::new();
    for entry in entries(path)? {
        if let Some(number) = number(&entry.file_name())
            && entry.path().is_dir()
        {
            found.push(Numbered {
                number,
                path: entry.path(),
            });
        }
    }
    Ok(found)
}

fn entries(path: &Path) -> Result<Vec<DirEntry>, GeoError> {
    std::fs::read_dir(path)
        .and_then(Iterator::collect)
        .map_err(|e| GeoError::io(path, e))
}

/// A file, or a link to one; opening anything else may block.
fn is_file(entry: &DirEntry) -> bool {
    match entry.file_type() {
        Ok(kind) if kind.is_symlink() => entry.path().is_file(),
        Ok(kind) => kind.is_file(),
        Err(_) => false,
    }
}

/// A number as tiles are named: decimal digits without leading zeros.
fn number(name: &OsStr) -> Option<u64> {
    let text = name.to_str()?;
    let value = text.parse::<u64>().ok()?;
    (value.to_string() == text).then_some(value)
}

/// Row and ending of the name of a tile.
fn tile_name(name: &str) -> Option<(u64, &str)> {
    let digits = name.bytes().take_while(u8::is_ascii_digit).count();
    let (row, ending) = name.split_at(digits);
    let row = number(OsStr::new(row))?;
    ENDINGS
        .iter()
        .any(|known| known.eq_ignore_ascii_case(ending))
        .then_some((row, ending))
}

/// Whether gdal2tiles says that rows are counted from the south.
fn rows_from_south(folder: &Path) -> Result<bool, GeoError> {
    let path = folder.join(TMS_DESCRIPTION);
    let length = match std::fs::metadata(&path) {
        Ok(metadata) if metadata.is_file() => metadata.len(),
        _ => return Ok(false),
    };
    if length > MAX_DESCRIPTION_BYTES {
        return Err(GeoError::damaged(&path, format!("it has {length} bytes")));
    }
    let text = std::fs::read(&path).map_err(|e| GeoError::io(&path, e))?;
    let text = String::from_utf8_lossy(&text);
    let is_mercator = ["mercator", "3857", "900913"]
        .iter()
        .any(|word| text.contains(word));
    if is_mercator {
        return Ok(true);
    }
    Err(GeoError::Unsupported {
        path,
        what: "tiles of another grid than Web Mercator".to_string(),
        advice: "make them again in Web Mercator (gdal2tiles --xyz --profile=mercator), or give the map they were made from",
    })
}
