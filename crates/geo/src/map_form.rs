//! Which form a map has.

use std::ffi::OsStr;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::GeoError;
use crate::pmtiles_directory::MAGIC as PMTILES;
use crate::xyz_folder::is_tile_folder;

/// What an SQLite database begins with.
const SQLITE: &[u8] = b"SQLite format 3\0";
/// What a TIFF file begins with: classic and BigTIFF, either byte order.
const TIFF: [&[u8]; 4] = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];

/// The form of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MapForm {
    /// A `.csv` of pictures and their corners.
    Table,
    /// A folder `{zoom}/{column}/{row}.png`.
    TileFolder,
    /// A folder of GeoTIFFs.
    TiffFolder,
    /// A `.txt` that lists GeoTIFFs.
    List,
    /// A VRT of GDAL.
    Vrt,
    /// PMTiles.
    PmTiles,
    /// An SQLite database: MBTiles.
    Sqlite,
    /// A TIFF file.
    Tiff,
    /// Any other file: a picture, or none of these.
    Picture,
}

/// The form of a map, from what it begins with; tables from their name.
pub(crate) fn form_of(path: &Path) -> Result<MapForm, GeoError> {
    if path.is_dir() {
        if is_tile_folder(path)? {
            return Ok(MapForm::TileFolder);
        }
        if holds_tiff(path)? {
            return Ok(MapForm::TiffFolder);
        }
        let below = match folder_with_tiffs(path)? {
            Some(folder) => format!(
                "; there are GeoTIFFs in the folder {}: give that one, or a list (.txt) of all files",
                folder.display()
            ),
            None => String::new(),
        };
        return Err(not_a_map(
            path,
            &format!(
                "the folder holds neither tiles ({{zoom}}/{{column}}/{{row}}.png) nor GeoTIFFs{below}"
            ),
        ));
    }
    let ending = path.extension().unwrap_or_default();
    if ending.eq_ignore_ascii_case("csv") {
        return Ok(MapForm::Table);
    }
    if ending.eq_ignore_ascii_case("txt") {
        return Ok(MapForm::List);
    }
    let start = start_of(path)?;
    if start.is_empty() {
        return Err(not_a_map(path, "it is empty"));
    }
    if TIFF.iter().any(|magic| start.starts_with(magic)) {
        return Ok(MapForm::Tiff);
    }
    if start.starts_with(SQLITE) {
        return Ok(MapForm::Sqlite);
    }
    if start.starts_with(PMTILES) {
        return Ok(MapForm::PmTiles);
    }
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&start);
    if text.trim_ascii_start().starts_with(b"<") && ending.eq_ignore_ascii_case("vrt")
        || text.starts_with(b"<VRTDataset")
    {
        return Ok(MapForm::Vrt);
    }
    Ok(MapForm::Picture)
}

/// Whether a name, or a path, is that of a GeoTIFF: a folder that is read as a map consists of these. `._map.tif` is what macOS keeps
/// beside `map.tif` on disks of other systems.
pub fn is_tiff_name(name: &OsStr) -> bool {
    let path = Path::new(name);
    let ending = path.extension().unwrap_or_default();
    let is_of_macos = path
        .file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"._"));
    !is_of_macos
        && ["tif", "tiff", "gtiff"]
            .iter()
            .any(|tiff| ending.eq_ignore_ascii_case(tiff))
}

fn holds_tiff(folder: &Path) -> Result<bool, GeoError> {
    for entry in std::fs::read_dir(folder).map_err(|e| GeoError::io(folder, e))? {
        let entry = entry.map_err(|e| GeoError::io(folder, e))?;
        if is_tiff_name(&entry.file_name()) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// A folder directly in a folder that holds GeoTIFFs, the first by name.
fn folder_with_tiffs(path: &Path) -> Result<Option<PathBuf>, GeoError> {
    let error = |e| GeoError::io(path, e);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(error)? {
        let folder = entry.map_err(error)?.path();
        // What cannot be read is of no help.
        if folder.is_dir() && holds_tiff(&folder).unwrap_or(false) {
            found.push(folder);
        }
    }
    Ok(found.into_iter().min())
}

/// The first bytes of a file.
pub(crate) fn start_of(path: &Path) -> Result<Vec<u8>, GeoError> {
    let mut start = Vec::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(64).read_to_end(&mut start))
        .map_err(|e| GeoError::io(path, e))?;
    Ok(start)
}

fn not_a_map(path: &Path, reason: &str) -> GeoError {
    GeoError::NotAMap {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    }
}
