//! A CSV of pictures and their corners, as one map.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::antimeridian::AroundTheWorld;
use crate::block_cache::BlockCache;
use crate::content_hash::ContentHash;
use crate::map_form::{MapForm, form_of};
use crate::picture::Picture;
use crate::single_map::describe;
use crate::text_file::BYTE_ORDER_MARK;
use crate::windowed::{check, empty_patch, read_window};
use crate::{Affine, Corners, Crs, GeoError, Georeference, LonLat, Raster, RasterPatch, WindowPx};

const ORDER: &str = "the columns are latitude and longitude of two corners, in degrees";

/// Pictures side by side. Where they overlap, the first one in the table is used.
pub(crate) struct CsvMosaic {
    path: PathBuf,
    pictures: Vec<Placed>,
    size_px: (u64, u64),
    georeference: Georeference,
    cache: Arc<BlockCache>,
    hash: ContentHash,
}

struct Placed {
    picture: Picture,
    /// Left and top edge, width and height in pixels of the mosaic.
    place: WindowPx,
}

struct Row {
    line: u64,
    file: PathBuf,
    corners: [Option<f64>; 8],
}

/// Columns, by corner and coordinate.
const TOP_LEFT_LAT: usize = 0;
const TOP_LEFT_LON: usize = 1;
const BOTTOM_RIGHT_LAT: usize = 2;
const BOTTOM_RIGHT_LON: usize = 3;
const LOWER_LEFT_LAT: usize = 4;
const LOWER_LEFT_LON: usize = 5;
const UPPER_RIGHT_LAT: usize = 6;
const UPPER_RIGHT_LON: usize = 7;

/// Opens a table of pictures. File names are relative to the folder of the table.
pub(crate) fn open_mosaic(path: &Path, cache: Arc<BlockCache>) -> Result<CsvMosaic, GeoError> {
    let rows = read_table(path)?;
    let mut placed = Vec::with_capacity(rows.len());
    let mut files = vec![path.to_path_buf()];
    for row in &rows {
        if form_of(&row.file).map_err(|e| e.of_member(path))? == MapForm::Tiff {
            let reason = format!(
                "{} is a TIFF file, and the picture of a row must be JPEG, PNG or WebP; GeoTIFFs go into a list (.txt)",
                row.file.display()
            );
            return Err(bad(path, row.line, &reason));
        }
        let picture = Picture::open(&row.file)?;
        let corners = row.corners(path, picture.size_px())?;
        files.push(row.file.clone());
        placed.push((picture, corners));
    }
    if placed.is_empty() {
        return Err(bad(path, 1, "the table lists no pictures"));
    }
    let edges = placed.iter().map(|(_, c)| (c.west_deg, c.east_deg));
    let around = AroundTheWorld::from_edges(edges, 360.0);
    for (_, corners) in &mut placed {
        let shift_deg = around.shift(corners.west_deg);
        corners.west_deg += shift_deg;
        corners.east_deg += shift_deg;
    }
    let pixel_sizes_deg = || placed.iter().map(|(p, c)| c.pixel_size_deg(p.size_px()));
    let lon_per_px = median(pixel_sizes_deg().map(|(lon, _)| lon));
    let lat_per_px = median(pixel_sizes_deg().map(|(_, lat)| lat));
    let all = || placed.iter().map(|(_, c)| c);
    let west = all().map(|c| c.west_deg).fold(f64::INFINITY, f64::min);
    let east = all().map(|c| c.east_deg).fold(f64::NEG_INFINITY, f64::max);
    let south = all().map(|c| c.south_deg).fold(f64::INFINITY, f64::min);
    let north = all().map(|c| c.north_deg).fold(f64::NEG_INFINITY, f64::max);
    let size_px = (
        ((east - west) / lon_per_px).ceil() as u64,
        ((north - south) / lat_per_px).ceil() as u64,
    );
    let affine = Affine::from_gdal([west, lon_per_px, 0.0, north, 0.0, -lat_per_px])
        .map_err(|e| e.in_file(path))?;
    let georeference = Georeference::new(affine, Crs::wgs84()?, size_px);
    let pictures = placed
        .into_iter()
        .map(|(picture, c)| Placed {
            picture,
            place: WindowPx::new(
                (c.west_deg - west) / lon_per_px,
                (north - c.north_deg) / lat_per_px,
                (c.east_deg - c.west_deg) / lon_per_px,
                (c.north_deg - c.south_deg) / lat_per_px,
            ),
        })
        .collect();
    Ok(CsvMosaic {
        path: path.to_path_buf(),
        pictures,
        size_px,
        georeference,
        cache,
        hash: ContentHash::of(files),
    })
}

impl Raster for CsvMosaic {
    fn size_px(&self) -> (u64, u64) {
        self.size_px
    }

    fn georeference(&self) -> &Georeference {
        &self.georeference
    }

    fn content_hash(&self) -> Result<[u8; 32], GeoError> {
        self.hash.get()
    }

    fn content_hash_now(&self) -> Result<[u8; 32], GeoError> {
        self.hash.of_now()
    }

    fn files(&self) -> Vec<PathBuf> {
        self.hash.files().to_vec()
    }

    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        check(window, out_w, out_h)?;
        let mut patch = empty_patch(out_w, out_h);
        for (id, placed) in self.pictures.iter().enumerate() {
            let Some((columns, rows)) = placed.output_pixels(window, out_w, out_h) else {
                continue;
            };
            // The part of the output that the picture can touch, as a window of the picture.
            let (w, h) = placed.picture.size_px();
            let (scale_x, scale_y) = (w as f64 / placed.place.w, h as f64 / placed.place.h);
            let (px, py) = (window.w / f64::from(out_w), window.h / f64::from(out_h));
            let part = WindowPx::new(
                (window.x + f64::from(columns.0) * px - placed.place.x) * scale_x,
                (window.y + f64::from(rows.0) * py - placed.place.y) * scale_y,
                f64::from(columns.1 - columns.0) * px * scale_x,
                f64::from(rows.1 - rows.0) * py * scale_y,
            );
            let (part_w, part_h) = (columns.1 - columns.0, rows.1 - rows.0);
            let piece = read_window(&placed.picture, id, &self.cache, part, part_w, part_h)?;
            for (x, y, seen) in piece.valid.enumerate_pixels() {
                let at = (columns.0 + x, rows.0 + y);
                if seen.0[0] != 0 && patch.valid.get_pixel(at.0, at.1).0[0] == 0 {
                    patch.rgb.put_pixel(at.0, at.1, *piece.rgb.get_pixel(x, y));
                    patch.valid.put_pixel(at.0, at.1, *seen);
                }
            }
        }
        Ok(patch)
    }

    fn describe(&self) -> String {
        let count = self.pictures.len();
        let kind = format!(
            "table of {count} picture{}",
            if count == 1 { "" } else { "s" }
        );
        describe(&self.path, self, &kind)
    }
}

impl Placed {
    /// Columns and rows `[start, end)` of the output that the picture can touch.
    fn output_pixels(
        &self,
        window: WindowPx,
        out_w: u32,
        out_h: u32,
    ) -> Option<((u32, u32), (u32, u32))> {
        let range = |start: f64, length: f64, from: f64, size: f64, count: u32| {
            let scale = size / f64::from(count);
            let first = ((start - from) / scale - 1.0).floor().max(0.0);
            let last = ((start + length - from) / scale + 1.0)
                .ceil()
                .min(f64::from(count));
            (last > first).then_some((first as u32, last as u32))
        };
        let columns = range(self.place.x, self.place.w, window.x, window.w, out_w)?;
        let rows = range(self.place.y, self.place.h, window.y, window.h, out_h)?;
        Some((columns, rows))
    }
}

impl Row {
    fn corners(&self, table: &Path, size_px: (u64, u64)) -> Result<Corners, GeoError> {
        let c = &self.corners;
        let west = c[TOP_LEFT_LON].or(c[LOWER_LEFT_LON]);
        let north = c[TOP_LEFT_LAT].or(c[UPPER_RIGHT_LAT]);
        let east = c[BOTTOM_RIGHT_LON].or(c[UPPER_RIGHT_LON]);
        let south = c[BOTTOM_RIGHT_LAT].or(c[LOWER_LEFT_LAT]);
        let (Some(west), Some(north), Some(east), Some(south)) = (west, north, east, south) else {
            return Err(bad(table, self.line, "a corner is missing"));
        };
        let location = format!("{}: line {}", table.display(), self.line);
        let (ll, ur) = (LonLat::new(west, south), LonLat::new(east, north));
        Corners::new(ll, ur, size_px, &location, ORDER)
    }
}

fn read_table(path: &Path) -> Result<Vec<Row>, GeoError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(|e| csv_error(path, e))?;
    let headers = reader.headers().map_err(|e| csv_error(path, e))?.clone();
    let file_column = headers
        .iter()
        .position(|name| {
            matches!(
                normal(name).as_str(),
                "filename" | "file" | "image" | "name"
            )
        })
        .ok_or_else(|| {
            // As spreadsheets write CSV where the comma is the decimal sign.
            let other = headers.iter().any(|name| name.contains([';', '\t']));
            bad(
                path,
                1,
                if other {
                    "there is no column 'filename': columns must be separated by commas"
                } else {
                    "there is no column 'filename'"
                },
            )
        })?;
    let columns: Vec<Option<usize>> = headers.iter().map(corner_column).collect();
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| csv_error(path, e))?;
        let line = record.position().map_or(0, csv::Position::line);
        let mut corners = [None; 8];
        for (text, column) in record.iter().zip(&columns) {
            // A pair of corners may be empty where the other one is given.
            if let Some(column) = column.filter(|_| !text.is_empty()) {
                let value = text
                    .parse::<f64>()
                    .map_err(|_| bad(path, line, &format!("'{text}' is not a number")))?;
                corners[column] = Some(value);
            }
        }
        let name = record.get(file_column).unwrap_or_default();
        if name.is_empty() {
            return Err(bad(path, line, "the file name is empty"));
        }
        rows.push(Row {
            line,
            file: folder.join(name),
            corners,
        });
    }
    Ok(rows)
}

fn normal(name: &str) -> String {
    name.trim_start_matches(BYTE_ORDER_MARK)
        .trim()
        .to_ascii_lowercase()
        .replace([' ', '-'], "_")
}

/// Which corner and coordinate a column holds: `top_left_lat`, `Bottom_right_long`, `LL_lon`,
/// `upper_right_latitude`.
fn corner_column(name: &str) -> Option<usize> {
    let name = normal(name);
    let (corner, coordinate) = name.rsplit_once('_')?;
    let is_lon = match coordinate {
        "lat" | "latitude" => 0,
        "lon" | "long" | "lng" | "longitude" => 1,
        _ => return None,
    };
    let first = match corner {
        "top_left" | "upper_left" | "tl" | "ul" => TOP_LEFT_LAT,
        "bottom_right" | "lower_right" | "br" | "lr" => BOTTOM_RIGHT_LAT,
        "bottom_left" | "lower_left" | "bl" | "ll" => LOWER_LEFT_LAT,
        "top_right" | "upper_right" | "tr" | "ur" => UPPER_RIGHT_LAT,
        _ => return None,
    };
    Some(first + is_lon)
}

fn csv_error(path: &Path, error: csv::Error) -> GeoError {
    let line = error.position().map_or(0, csv::Position::line);
    match error.into_kind() {
        csv::ErrorKind::Io(source) => GeoError::io(path, source),
        csv::ErrorKind::Utf8 { err, .. } => bad(path, line, &format!("{err}; save it as UTF-8")),
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => bad(
            path,
            line,
            &format!("{len} values where there are {expected_len} columns"),
        ),
        other => bad(path, line, &format!("{other:?}")),
    }
}

fn bad(path: &Path, line: u64, reason: &str) -> GeoError {
    GeoError::BadTable {
        path: path.to_path_buf(),
        line,
        reason: reason.to_string(),
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
