//! A map of tiles as a raster.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use crate::block::BlockSource;
use crate::block_cache::BlockCache;
use crate::single_map::describe;
use crate::tile_map::TileMap;
use crate::tile_store::TileStore;
use crate::windowed::read_window;
use crate::{GeoError, Georeference, Raster, RasterPatch, WindowPx};

/// Tiles with their place on Earth.
pub(crate) struct TileRaster {
    map: TileMap,
    georeference: Georeference,
    hash: OnceLock<[u8; 32]>,
    cache: Arc<BlockCache>,
}

impl TileRaster {
    /// A raster of the tiles of `zoom`, the finest one by default.
    pub fn new(
        store: Box<dyn TileStore>,
        zoom: Option<u8>,
        cache: Arc<BlockCache>,
    ) -> Result<Self, GeoError> {
        let map = TileMap::new(store, zoom)?;
        let georeference = map.georeference()?;
        Ok(Self {
            map,
            georeference,
            hash: OnceLock::new(),
            cache,
        })
    }
}

impl Raster for TileRaster {
    fn size_px(&self) -> (u64, u64) {
        let full = self.map.levels()[0];
        (full.width, full.height)
    }

    fn georeference(&self) -> &Georeference {
        &self.georeference
    }

    fn content_hash(&self) -> Result<[u8; 32], GeoError> {
        if let Some(hash) = self.hash.get() {
            return Ok(*hash);
        }
        let hash = self.map.hash()?;
        Ok(*self.hash.get_or_init(|| hash))
    }

    fn content_hash_now(&self) -> Result<[u8; 32], GeoError> {
        self.map.hash()
    }

    fn files(&self) -> Vec<PathBuf> {
        self.map.store().files()
    }

    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        read_window(&self.map, 0, &self.cache, window, out_w, out_h)
    }

    fn describe(&self) -> String {
        describe(self.map.store().path(), self, &self.map.kind())
    }

    fn caveats(&self) -> Vec<String> {
        self.map.caveats()
    }
}
