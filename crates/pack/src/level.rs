//! One level of ground resolution: its tiles, their descriptors and features.

use std::path::Path;
use std::sync::Arc;

use grimnet_geo::{Georeference, LevelFrame, LevelPx, LonLat, MapPx};
use grimnet_net::Statistics;

use crate::error::{PackError, Result};
use crate::features::{FeatureBlock, TileFeatures};
use crate::format::{TileEntry, UnitEntry, UnitState};
use crate::index::Index;
use crate::manifest::{LevelManifest, Manifest};
use crate::mapped::Mapped;
use crate::search::ivf_pq::IvfPqView;

/// Side of a cell, level pixels: half a tile.
pub const CELL_PX: u32 = 256;

/// Side of a tile, level pixels (paper: Sp = 512).
pub const TILE_PX: u32 = 512;

/// One level of a pack.
#[derive(Clone, Debug)]
pub struct Level {
    file: Arc<Mapped>,
    georeference: Arc<Georeference>,
    manifest: LevelManifest,
    descriptor_dim: usize,
    global_dim: usize,
    tiles: Part,
    units: Part,
    features: Part,
    globals: Part,
    global_scales: Part,
    statistics: Option<Part>,
    ivf_lists: Option<IvfParts>,
}

/// A section's place.
#[derive(Clone, Copy, Debug)]
struct Part {
    offset: u64,
    len: u64,
}

#[derive(Clone, Copy, Debug)]
struct IvfParts {
    centroids: Part,
    codebooks: Part,
    list_starts: Part,
    ids: Part,
    codes: Part,
}

/// Where a tile lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileInfo {
    /// Index among the tiles of its level.
    pub index: usize,
    /// Column and row in the tile grid.
    pub grid: [u32; 2],
    /// Top-left corner, level pixels.
    pub origin_px: [i64; 2],
    /// Centre.
    pub centre_px: LevelPx,
    /// Centre on the map.
    pub centre_map_px: MapPx,
}

impl Level {
    /// Views level `index`, checking that every reference inside it holds.
    pub(crate) fn new(
        path: &Path,
        file: &Arc<Mapped>,
        pack: &Manifest,
        georeference: &Arc<Georeference>,
        index: usize,
    ) -> Result<Self> {
        let manifest = pack.levels[index].clone();
        let find = |name: &str| {
            let name = format!("{index}/{name}");
            let section = pack.sections.iter().find(|s| s.name == name);
            section.map(|s| Part {
                offset: s.offset,
                len: s.len,
            })
        };
        let need = |name: &str| {
            find(name).ok_or_else(|| {
                PackError::corrupt(path, format!("section {index}/{name} is missing"))
            })
        };
        let ivf_lists = match manifest.index {
            Index::Exact => None,
            Index::IvfPq { .. } => Some(IvfParts {
                centroids: need("ivf.centroids")?,
                codebooks: need("ivf.codebooks")?,
                list_starts: need("ivf.list_starts")?,
                ids: need("ivf.ids")?,
                codes: need("ivf.codes")?,
            }),
        };
        let level = Self {
            file: Arc::clone(file),
            georeference: Arc::clone(georeference),
            descriptor_dim: pack.model.descriptor_dim,
            global_dim: pack.model.global_dim,
            tiles: need("tiles")?,
            units: need("units")?,
            features: need("features")?,
            globals: need("globals")?,
            global_scales: need("global_scales")?,
            statistics: find("statistics"),
            ivf_lists,
            manifest,
        };
        level.check(path, index)?;
        Ok(level)
    }

    /// Checks lengths and references, so that no accessor can leave the file later.
    fn check(&self, path: &Path, index: usize) -> Result<()> {
        let m = &self.manifest;
        let wrong = |what: &str| Err(PackError::corrupt(path, format!("level {index}: {what}")));
        let usable = |v: f64| v.is_finite() && v > 0.0;
        if !(usable(m.frame.gsd_m)
            && usable(m.frame.map_px_per_level_px_x)
            && usable(m.frame.map_px_per_level_px_y))
        {
            return wrong("impossible resolution");
        }
        if self.descriptor_dim == 0 || self.global_dim == 0 || m.network_px == 0 || m.tile_px == 0 {
            return wrong("impossible sizes");
        }
        let product = |a: u64, b: u64| a.checked_mul(b);
        let expected = [
            (self.tiles, product(m.tiles, size_of::<TileEntry>() as u64)),
            (self.globals, product(m.tiles, self.global_dim as u64)),
            (self.global_scales, product(m.tiles, 4)),
            (
                self.units,
                product(u64::from(m.unit_grid[0]), u64::from(m.unit_grid[1]))
                    .and_then(|n| product(n, size_of::<UnitEntry>() as u64)),
            ),
        ];
        if expected.iter().any(|(part, len)| Some(part.len) != *len) {
            return wrong("sections of the wrong length");
        }
        let Some(span) = m.units_per_tile_side.checked_sub(1) else {
            return wrong("impossible sizes");
        };
        let fits = |tile: &TileEntry| {
            tile.column < m.tile_grid[0]
                && tile.row < m.tile_grid[1]
                && tile.column + span < m.unit_grid[0]
                && tile.row + span < m.unit_grid[1]
        };
        if !self.tile_entries().iter().all(fits) {
            return wrong("a tile outside the grid");
        }
        for unit in self.unit_entries() {
            let layout =
                crate::format::BlobLayout::new(unit.keypoints as usize, self.descriptor_dim);
            let end = unit.offset.checked_add(layout.stored_len() as u64);
            if end.is_none_or(|end| end > self.features.len) || unit.offset % 64 != 0 {
                return wrong("features outside their section");
            }
        }
        if let Some(parts) = &self.ivf_lists
            && self.ivf_pq_of(parts).is_none()
        {
            return wrong("the index does not fit the tiles");
        }
        Ok(())
    }

    fn bytes(&self, part: Part) -> &[u8] {
        self.file.section(part.offset, part.len)
    }

    /// A section as numbers; sections start at multiples of 64 in a page-aligned mapping.
    fn slice<T: bytemuck::Pod>(&self, part: Part) -> &[T] {
        bytemuck::try_cast_slice(self.bytes(part)).unwrap_or_default()
    }

    fn tile_entries(&self) -> &[TileEntry] {
        self.slice(self.tiles)
    }

    pub(crate) fn unit_entries(&self) -> &[UnitEntry] {
        self.slice(self.units)
    }

    /// Ground resolution, scale factors to map pixels and size.
    pub fn frame(&self) -> &LevelFrame {
        &self.manifest.frame
    }

    /// What the pack says about this level.
    pub fn manifest(&self) -> &LevelManifest {
        &self.manifest
    }

    /// Metres a level pixel, at the map's centre.
    pub fn gsd_m(&self) -> f64 {
        self.manifest.frame.gsd_m
    }

    /// The map in level pixels.
    pub fn size_px(&self) -> [u64; 2] {
        [self.manifest.frame.width_px, self.manifest.frame.height_px]
    }

    /// Side of a tile, level pixels.
    pub fn tile_px(&self) -> u32 {
        self.manifest.tile_px
    }

    /// Side of a tile, metres at the map's centre.
    pub fn tile_m(&self) -> f64 {
        f64::from(self.manifest.tile_px) * self.manifest.frame.gsd_m
    }

    /// Numbers in a local descriptor.
    pub fn descriptor_dim(&self) -> usize {
        self.descriptor_dim
    }

    /// Numbers in a tile descriptor.
    pub fn global_dim(&self) -> usize {
        self.global_dim
    }

    /// What one step of a local descriptor is worth.
    pub fn descriptor_scale(&self) -> f32 {
        self.manifest.descriptor_scale
    }

    /// The map's affine transform and coordinate system.
    pub fn georeference(&self) -> &Georeference {
        &self.georeference
    }

    /// The index that the level was built with.
    pub fn index(&self) -> Index {
        self.manifest.index
    }

    /// Number of tiles with a descriptor.
    pub fn tile_count(&self) -> usize {
        self.tile_entries().len()
    }

    /// Where tile `i` lies.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn tile(&self, i: usize) -> TileInfo {
        let TileEntry { column, row } = self.tile_entries()[i];
        let m = &self.manifest;
        let origin =
            |a: usize, step: u32| m.origin_px[a] + i64::from(step) * i64::from(m.stride_px);
        let origin_px = [origin(0, column), origin(1, row)];
        let half = f64::from(m.tile_px) / 2.0;
        let centre_px = LevelPx::from(origin_px.map(|v| v as f64 + half));
        TileInfo {
            index: i,
            grid: [column, row],
            origin_px,
            centre_px,
            centre_map_px: self.map_px_from_level_px(centre_px),
        }
    }

    /// Index of the tile at a place of the tile grid, if it has a descriptor.
    pub fn tile_at(&self, grid: [u32; 2]) -> Option<usize> {
        // Tiles lie row by row.
        self.tile_entries()
            .binary_search_by_key(&(grid[1], grid[0]), |t| (t.row, t.column))
            .ok()
    }

    /// Map pixel of a point of the level.
    pub fn map_px_from_level_px(&self, point: LevelPx) -> MapPx {
        self.manifest.frame.map_px_from_level_px(point)
    }

    /// Point of the level that a map pixel lies at.
    pub fn level_px_from_map_px(&self, point: MapPx) -> LevelPx {
        self.manifest.frame.level_px_from_map_px(point)
    }

    /// Longitude and latitude of a point of the level.
    ///
    /// # Errors
    /// Returns [`PackError::Map`] if the map's coordinate system does not cover the point.
    pub fn lonlat_from_level_px(&self, point: LevelPx) -> Result<LonLat> {
        Ok(self
            .georeference
            .lonlat_from_map_px(self.map_px_from_level_px(point))?)
    }

    /// Point of the level at a longitude and latitude.
    ///
    /// # Errors
    /// Returns [`PackError::Map`] if the map's coordinate system does not cover the position.
    pub fn level_px_from_lonlat(&self, place: LonLat) -> Result<LevelPx> {
        Ok(self.level_px_from_map_px(self.georeference.map_px_from_lonlat(place)?))
    }

    /// Features of tile `i` as they are stored: one block per cell, or a single one in paper mode.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn blocks(&self, i: usize) -> Vec<FeatureBlock<'_>> {
        let TileEntry { column, row } = self.tile_entries()[i];
        let m = &self.manifest;
        let px_per_stored_px = m.tile_px as f32 / m.network_px as f32;
        let side = m.units_per_tile_side;
        let (units, features) = (self.unit_entries(), self.bytes(self.features));
        let places = (0..side).flat_map(|dy| (0..side).map(move |dx| (dx, dy)));
        places
            .filter_map(|(dx, dy)| {
                let at = (row + dy) as usize * m.unit_grid[0] as usize + (column + dx) as usize;
                let unit = units.get(at).filter(|u| u.keypoints > 0)?;
                let offset_px = [dx, dy].map(|d| (d * m.stride_px) as f32);
                let blob = features.get(unit.offset as usize..)?;
                FeatureBlock::new(
                    blob,
                    unit.keypoints as usize,
                    self.descriptor_dim,
                    offset_px,
                    px_per_stored_px,
                )
            })
            .collect()
    }

    /// Features of tile `i`, strongest first.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn features(&self, i: usize) -> TileFeatures {
        self.strongest_features(i, usize::MAX)
    }

    /// The `most` strongest features of tile `i`, strongest first.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn strongest_features(&self, i: usize, most: usize) -> TileFeatures {
        TileFeatures::gather(
            &self.blocks(i),
            self.descriptor_dim,
            self.manifest.descriptor_scale,
            most,
        )
    }

    /// Tile descriptors, `tile_count x global_dim`, as bytes; row `i` is worth [`Level::global_scales`]`[i]` a step.
    pub fn globals(&self) -> &[i8] {
        self.slice(self.globals)
    }

    /// What one step of each tile descriptor is worth.
    pub fn global_scales(&self) -> &[f32] {
        self.slice(self.global_scales)
    }

    /// Descriptor of tile `i`, a unit vector but for rounding.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn global(&self, i: usize) -> Vec<f32> {
        let scale = self.global_scales()[i];
        let row = &self.globals()[i * self.global_dim..(i + 1) * self.global_dim];
        row.iter().map(|&v| f32::from(v) * scale).collect()
    }

    /// Normalisation statistics that were adapted to the map at this level, if the pack was built so.
    ///
    /// # Errors
    /// Where the stored statistics cannot be read.
    pub fn statistics(&self) -> Result<Option<Statistics>> {
        Ok(self
            .statistics
            .map(|part| Statistics::from_bytes(self.bytes(part)))
            .transpose()?)
    }

    /// Whether the place of feature unit (column, row) was computed.
    pub fn unit_is_computed(&self, unit: [u32; 2]) -> bool {
        let at = unit[1] as usize * self.manifest.unit_grid[0] as usize + unit[0] as usize;
        unit[0] < self.manifest.unit_grid[0]
            && self
                .unit_entries()
                .get(at)
                .is_some_and(|u| u.state == UnitState::Computed as u32)
    }

    /// Bytes of this level in the file, shared parts (manifest, statistics) left out.
    pub fn len_bytes(&self) -> u64 {
        let ivf = self.ivf_lists.map_or(0, |p| {
            [p.centroids, p.codebooks, p.list_starts, p.ids, p.codes]
                .iter()
                .map(|part| part.len)
                .sum()
        });
        let parts = [
            self.tiles,
            self.units,
            self.features,
            self.globals,
            self.global_scales,
        ];
        parts.iter().map(|part| part.len).sum::<u64>() + ivf
    }

    /// The IVF-PQ index, if the level has one.
    pub(crate) fn ivf_pq(&self) -> Option<IvfPqView<'_>> {
        self.ivf_lists
            .as_ref()
            .and_then(|parts| self.ivf_pq_of(parts))
    }

    fn ivf_pq_of(&self, parts: &IvfParts) -> Option<IvfPqView<'_>> {
        let Index::IvfPq {
            nlist,
            subquantisers,
            ..
        } = self.manifest.index
        else {
            return None;
        };
        IvfPqView::new(
            self.global_dim,
            nlist as usize,
            subquantisers as usize,
            self.tile_count(),
            self.slice(parts.centroids),
            self.slice(parts.codebooks),
            self.slice(parts.list_starts),
            self.slice(parts.ids),
            self.bytes(parts.codes),
        )
    }
}
