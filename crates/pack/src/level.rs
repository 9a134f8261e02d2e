//! One level of ground resolution: its tiles, their descriptors and features.

use std::sync::Arc;

use grimnet_geo::{Georeference, LevelFrame, LevelPx, LonLat, MapPx};
use grimnet_net::Statistics;
use memmap2::Mmap;

use crate::error::{PackError, Result};
use crate::feature_store::FeatureStore;
use crate::features::{FeatureBlock, TileFeatures};
use crate::file::PackFile;
use crate::format::{BlobLayout, TileEntry};
use crate::global_rows::GlobalRows;
use crate::index::Index;
use crate::level_tables::{Tables, features_of};
use crate::local_descriptors::DescriptorType;
use crate::manifest::{LevelManifest, Manifest};
use crate::search::ivf_pq::IvfPqView;
use crate::search::keypoint_index::KeypointIndex;
use grimnet_limits::PackLimits;

/// Side of a cell, level pixels: half a tile.
pub const CELL_PX: u32 = 256;

/// Side of a tile, level pixels (paper: Sp = 512).
pub const TILE_PX: u32 = 512;

/// One level of a pack.
#[derive(Clone, Debug)]
pub struct Level {
    georeference: Arc<Georeference>,
    manifest: Arc<LevelManifest>,
    descriptor_dim: usize,
    global_dim: usize,
    len_bytes: u64,
    tables: Arc<Tables>,
    features: Arc<FeatureStore>,
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
    /// Opens level `index` and checks that every reference inside it holds, so that no accessor can fail later.
    pub(crate) fn open(
        file: &Arc<PackFile>,
        map: Option<&Arc<Mmap>>,
        pack: &Manifest,
        georeference: &Arc<Georeference>,
        index: usize,
        limits: &PackLimits,
    ) -> Result<Self> {
        let manifest = pack.levels[index].clone();
        let tables = Tables::open(file, pack, index)?;
        let (features, block_hashes) = features_of(file, pack, index)?;
        let prefix = format!("{index}/");
        let sections = pack.sections.iter();
        let level = Self {
            georeference: Arc::clone(georeference),
            manifest: Arc::new(manifest),
            descriptor_dim: pack.model.descriptor_dim,
            global_dim: pack.model.global_dim,
            len_bytes: sections
                .filter(|s| s.name.starts_with(&prefix))
                .map(|s| s.len)
                .sum(),
            tables: Arc::new(tables),
            features: Arc::new(FeatureStore::open(
                file,
                map,
                features,
                block_hashes,
                limits,
            )?),
        };
        level
            .tables
            .check(
                &level.manifest,
                level.descriptor_dim,
                level.global_dim,
                features.len,
            )
            .map_err(|what| PackError::corrupt(file.path(), format!("level {index}: {what}")))?;
        Ok(level)
    }

    /// Ground resolution, scale factors to map pixels and size.
    pub fn frame(&self) -> &LevelFrame {
        &self.manifest.frame
    }

    /// The manifest of the level.
    pub fn manifest(&self) -> &LevelManifest {
        &self.manifest
    }

    /// Metres per level pixel, at the map's centre.
    pub fn gsd_m(&self) -> f64 {
        self.manifest.frame.gsd_m
    }

    /// Width and height of the map, level pixels.
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

    /// Level pixels per pixel of the picture that the network saw: 1 except in packs of paper mode.
    pub fn px_per_network_px(&self) -> f64 {
        f64::from(self.manifest.tile_px) / f64::from(self.manifest.network_px)
    }

    /// Numbers in a local descriptor.
    pub fn descriptor_dim(&self) -> usize {
        self.descriptor_dim
    }

    /// Numbers in a tile descriptor.
    pub fn global_dim(&self) -> usize {
        self.global_dim
    }

    /// How descriptors are stored.
    pub fn descriptor_type(&self) -> DescriptorType {
        self.manifest.descriptor_type
    }

    /// Bytes of a local descriptor in the file.
    fn descriptor_len(&self) -> usize {
        self.descriptor_dim * self.descriptor_type().number_len()
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
        self.tables.tiles().len()
    }

    /// Where tile `i` lies.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn tile(&self, i: usize) -> TileInfo {
        let TileEntry { column, row } = self.tables.tiles()[i];
        let grid = [column, row];
        let centre_px = self.centre_px(grid);
        TileInfo {
            index: i,
            grid,
            origin_px: self.origin_px(grid),
            centre_px,
            centre_map_px: self.map_px_from_level_px(centre_px),
        }
    }

    /// Top left corner of the tile at a column and row of the tile grid.
    fn origin_px(&self, grid: [u32; 2]) -> [i64; 2] {
        let m = &self.manifest;
        let origin = |a: usize| m.origin_px[a] + i64::from(grid[a]) * i64::from(m.stride_px);
        [origin(0), origin(1)]
    }

    /// Centre of the tile at a column and row of the tile grid, whether or not it is stored or the grid ends before.
    pub fn centre_px(&self, grid: [u32; 2]) -> LevelPx {
        let half = f64::from(self.manifest.tile_px) / 2.0;
        LevelPx::from(self.origin_px(grid).map(|v| v as f64 + half))
    }

    /// Index of the tile at a column and row of the tile grid, if it has a descriptor.
    pub fn tile_at(&self, grid: [u32; 2]) -> Option<usize> {
        // Tiles are stored row by row.
        self.tables
            .tiles()
            .binary_search_by_key(&(grid[1], grid[0]), |t| (t.row, t.column))
            .ok()
    }

    /// The tile whose centre is nearest to a point, if it has a descriptor.
    pub fn tile_around(&self, point: LevelPx) -> Option<usize> {
        let m = &self.manifest;
        let half = f64::from(m.tile_px) / 2.0;
        let step = |along: f64, a: usize| {
            let steps = (along - m.origin_px[a] as f64 - half) / f64::from(m.stride_px);
            // Negative numbers become 0.
            (steps.round() as u32).min(m.tile_grid[a].saturating_sub(1))
        };
        self.tile_at([step(point.x, 0), step(point.y, 1)])
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
    /// # Errors
    /// Returns [`PackError::Corrupt`] if the features differ from their checksum, [`PackError::Changed`] if the file
    /// was truncated since it was opened.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn blocks(&self, i: usize) -> Result<Vec<FeatureBlock<'_>>> {
        let TileEntry { column, row } = self.tables.tiles()[i];
        let m = &self.manifest;
        let px_per_stored_px = self.px_per_network_px() as f32;
        let side = m.units_per_tile_side;
        let units = self.tables.units();
        let mut blocks = Vec::with_capacity((side * side) as usize);
        for (dy, dx) in (0..side).flat_map(|dy| (0..side).map(move |dx| (dy, dx))) {
            let at = (row + dy) as usize * m.unit_grid[0] as usize + (column + dx) as usize;
            let Some(unit) = units.get(at).filter(|u| u.keypoints > 0) else {
                continue;
            };
            let keypoints = unit.keypoints as usize;
            let descriptor_len = self.descriptor_len();
            let Some(layout) = BlobLayout::new(keypoints, descriptor_len) else {
                continue;
            };
            let start = unit.offset as usize;
            let blob = self.features.get(start..start + layout.end)?;
            blocks.extend(FeatureBlock::new(
                blob,
                keypoints,
                descriptor_len,
                [dx, dy].map(|d| (d * m.stride_px) as f32),
                px_per_stored_px,
            ));
        }
        Ok(blocks)
    }

    /// Features of tile `i`, strongest first.
    ///
    /// # Errors
    /// As [`Level::blocks`].
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn features(&self, i: usize) -> Result<TileFeatures> {
        self.strongest_features(i, usize::MAX)
    }

    /// The `most` strongest features of tile `i`, strongest first.
    ///
    /// # Errors
    /// As [`Level::blocks`].
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn strongest_features(&self, i: usize, most: usize) -> Result<TileFeatures> {
        Ok(TileFeatures::gather(
            &self.blocks(i)?,
            self.descriptor_dim,
            (self.descriptor_type(), self.manifest.descriptor_scale),
            most,
        ))
    }

    /// Tile descriptors, `tile_count x global_dim`.
    pub(crate) fn globals(&self) -> GlobalRows<'_> {
        self.tables.globals(self.descriptor_type())
    }

    /// Descriptor of tile `i`, a unit vector except for rounding.
    ///
    /// # Panics
    /// If `i` is not below [`Level::tile_count`].
    pub fn global(&self, i: usize) -> Vec<f32> {
        let row = i * self.global_dim..(i + 1) * self.global_dim;
        match self.globals() {
            GlobalRows::Int8 { rows, scales } => rows[row]
                .iter()
                .map(|&v| f32::from(v) * scales[i])
                .collect(),
            GlobalRows::Float32(rows) => rows[row].to_vec(),
        }
    }

    /// Normalisation statistics that were adapted to the map at this level, if the pack has them.
    ///
    /// # Errors
    /// Returns [`PackError::Net`] if the stored statistics cannot be read.
    pub fn statistics(&self) -> Result<Option<Statistics>> {
        Ok(self
            .tables
            .statistics()
            .map(Statistics::from_bytes)
            .transpose()?)
    }

    /// Bytes of this level in the file, the manifest left out.
    pub fn len_bytes(&self) -> u64 {
        self.len_bytes
    }

    /// The IVF-PQ index, if the level has one.
    pub(crate) fn ivf_pq(&self) -> Option<IvfPqView<'_>> {
        self.tables.ivf_pq(self.manifest.index, self.global_dim)
    }

    /// The index of the level's keypoints, if it has one: if the pack was built in default mode and the level has many tiles.
    pub fn keypoint_index(&self) -> Option<KeypointIndex<'_>> {
        self.tables
            .keypoint_index(&self.manifest, self.descriptor_dim)
    }
}
