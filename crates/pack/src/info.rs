//! A summary of a pack, for people and as JSON.

use std::fmt;

use grimnet_net::Precision;
use serde::Serialize;

use crate::index::Index;
use crate::manifest::KeypointIndexShape;
use crate::mode::Mode;
use crate::pack::Pack;
use crate::printable::Printable;

/// Values of the paper's local descriptors (eq. 14) and tile descriptors (eq. 8).
const PAPER_DIMS: [usize; 2] = [256, 512];

/// Summary of a pack.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PackInfo {
    /// Bytes of the file.
    pub len_bytes: u64,
    /// The pack format.
    pub format_version: u32,
    /// Program that wrote it.
    pub created_by: String,
    /// `paper` or `default`.
    pub mode: Mode,
    /// Hash of the model, hex.
    pub model_hash: String,
    /// Preset and name of the model.
    pub model: String,
    /// Numbers in a local descriptor.
    pub descriptor_dim: usize,
    /// Numbers in a tile descriptor.
    pub global_dim: usize,
    /// Precision of the network that computed features.
    #[serde(skip_serializing_if = "Precision::is_f32")]
    pub precision: Precision,
    /// Whether the weights of the model are random, so that the pack cannot be used to localise.
    pub model_is_random: bool,
    /// Hash of the map, hex.
    pub map_hash: String,
    /// Description of the map.
    pub map: String,
    /// Width and height of the map, pixels.
    pub map_px: [u64; 2],
    /// Width and height of the map, metres, measured at its centre.
    pub map_m: [f64; 2],
    /// Coordinate system.
    pub crs: String,
    /// GDAL geotransform.
    pub geotransform: [f64; 6],
    /// Longitude and latitude of the map's centre, degrees.
    #[serde(rename = "center_lon_lat_deg")]
    pub centre_lon_lat_deg: Option<[f64; 2]>,
    /// Levels, finest first.
    pub levels: Vec<LevelInfo>,
}

/// Summary of a level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelInfo {
    /// Metres per pixel.
    pub gsd_m: f64,
    /// Side of a tile, metres.
    pub tile_m: f64,
    /// Tiles with a descriptor.
    pub tiles: u64,
    /// Tiles without a descriptor.
    pub tiles_skipped: u64,
    /// Cells (default mode) or tiles (paper mode) with features.
    pub units: u64,
    /// Units without features.
    pub units_skipped: u64,
    /// Mean number of keypoints per unit.
    pub keypoints_per_unit: f64,
    /// Bytes of the level in the file.
    pub len_bytes: u64,
    /// Bytes of the level per unit with features.
    pub bytes_per_unit: f64,
    /// Tiles that adapted statistics were computed from; 0 if the model's own were used.
    pub adapted_from_tiles: u32,
    /// Units along the side of a tile: 2 cells, or 1 in paper mode.
    pub units_per_tile_side: u32,
    /// How tile descriptors are searched.
    pub index: Index,
    /// Why the index is not the one that could be expected; empty if it is.
    pub index_note: String,
    /// Share of the ten nearest neighbours that an IVF-PQ index finds.
    pub index_recall_at_10: Option<f64>,
    /// The index of the level's keypoints, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keypoint_index: Option<KeypointIndexShape>,
}

impl Pack {
    /// Summary of the pack.
    pub fn info(&self) -> PackInfo {
        let manifest = self.manifest();
        let map = &manifest.map;
        let card = |key: &str| manifest.model.card.get(key);
        let name = card("name").and_then(|v| v.as_str()).unwrap_or_default();
        let georeference = self.georeference();
        let centre = georeference
            .lonlat_from_map_px(georeference.centre_px())
            .ok();
        PackInfo {
            len_bytes: self.len_bytes(),
            format_version: manifest.format_version,
            created_by: manifest.created_by.clone(),
            mode: manifest.mode,
            model_hash: manifest.model.hash.clone(),
            model: format!("{} {name}", manifest.model.preset)
                .trim()
                .to_owned(),
            descriptor_dim: manifest.model.descriptor_dim,
            global_dim: manifest.model.global_dim,
            precision: manifest.model.precision,
            model_is_random: card("random").and_then(|v| v.as_bool()).unwrap_or(false),
            map_hash: map.hash.clone(),
            map: map.description.clone(),
            map_px: map.size_px,
            map_m: std::array::from_fn(|a| map.size_px[a] as f64 * map.ground_resolution_m[a]),
            crs: georeference.crs().definition().to_owned(),
            geotransform: georeference.affine().to_gdal(),
            centre_lon_lat_deg: centre.map(|place| [place.lon_deg, place.lat_deg]),
            levels: self
                .levels()
                .iter()
                .map(|level| {
                    let m = level.manifest();
                    let per_unit = |value: u64| value as f64 / m.units.max(1) as f64;
                    LevelInfo {
                        gsd_m: level.gsd_m(),
                        tile_m: level.tile_m(),
                        tiles: m.tiles,
                        tiles_skipped: m.tiles_skipped,
                        units: m.units,
                        units_skipped: m.units_skipped,
                        keypoints_per_unit: per_unit(m.keypoints),
                        len_bytes: level.len_bytes(),
                        bytes_per_unit: per_unit(level.len_bytes()),
                        adapted_from_tiles: m.adapted_from_tiles,
                        units_per_tile_side: m.units_per_tile_side,
                        index: m.index,
                        index_note: m.index_note.clone(),
                        index_recall_at_10: m.index_recall_at_10,
                        keypoint_index: m.keypoint_index,
                    }
                })
                .collect(),
        }
    }
}

impl LevelInfo {
    /// Writes the line about this level.
    fn write_line(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = if self.units_per_tile_side == 1 {
            "tile"
        } else {
            "cell"
        };
        write!(
            f,
            "level    {:.3} m/px: {} tiles of {:.0} m ({} skipped), {} {unit}s ({} skipped), \
             {:.0} keypoints and {} per {unit}, ",
            self.gsd_m,
            self.tiles,
            self.tile_m,
            self.tiles_skipped,
            self.units,
            self.units_skipped,
            self.keypoints_per_unit,
            Bytes(self.bytes_per_unit),
        )?;
        match self.index {
            Index::Exact => write!(f, "exact search")?,
            Index::IvfPq {
                nlist,
                subquantisers,
                nprobe,
                rerank_factor,
            } => {
                write!(f, "IVF{nlist} PQ{subquantisers} nprobe {nprobe}")?;
                if rerank_factor > 0 {
                    write!(f, ", re-ranked")?;
                }
            }
        }
        if let Some(recall) = self.index_recall_at_10 {
            write!(f, ", recall at 10 of {:.1} %", 100.0 * recall)?;
        }
        if let Some(shape) = self.keypoint_index {
            write!(f, ", keypoints indexed in {} lists", shape.lists)?;
        }
        if !self.index_note.is_empty() {
            write!(f, " ({})", Printable(&self.index_note))?;
        }
        if self.adapted_from_tiles > 0 {
            write!(
                f,
                ", statistics adapted on {} tiles",
                self.adapted_from_tiles
            )?;
        }
        writeln!(f)
    }
}

impl fmt::Display for PackInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mode = self.mode;
        let short = |hash: &str| hash.chars().take(16).collect::<String>();
        writeln!(
            f,
            "pack     format {}, {mode} mode, {}",
            self.format_version,
            Bytes(self.len_bytes as f64)
        )?;
        let random = if self.model_is_random {
            " - RANDOM weights: this pack cannot be used to localise"
        } else {
            ""
        };
        let precision = match self.precision {
            Precision::F32 => String::new(),
            other => format!(", computed in {other}"),
        };
        writeln!(
            f,
            "model    {} ({}){precision}{random}",
            Printable(&self.model),
            Printable(&short(&self.model_hash))
        )?;
        let dims = [self.descriptor_dim, self.global_dim];
        if mode == Mode::Paper && dims != PAPER_DIMS {
            let [local, of_tile] = PAPER_DIMS;
            writeln!(
                f,
                "         local descriptors of {} values, tile descriptors of {}: the paper's procedure with another network than the \
                 paper's, which has {local} and {of_tile}",
                self.descriptor_dim, self.global_dim
            )?;
        }
        writeln!(
            f,
            "map      {} ({})",
            Printable(&self.map),
            Printable(&short(&self.map_hash))
        )?;
        let [w, h] = self.map_px;
        writeln!(
            f,
            "         {w} x {h} px, {:.0} x {:.0} m, {}",
            self.map_m[0],
            self.map_m[1],
            Printable(&self.crs)
        )?;
        if let Some([lon, lat]) = self.centre_lon_lat_deg {
            writeln!(f, "centre   {lat:.6}, {lon:.6} (lat, lon)")?;
        }
        for level in &self.levels {
            level.write_line(f)?;
        }
        Ok(())
    }
}

/// A number of bytes with a unit.
struct Bytes(f64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            b if b < 1e3 => write!(f, "{b:.0} B"),
            b if b < 1e6 => write!(f, "{:.1} kB", b / 1e3),
            b if b < 1e9 => write!(f, "{:.1} MB", b / 1e6),
            b => write!(f, "{:.2} GB", b / 1e9),
        }
    }
}
