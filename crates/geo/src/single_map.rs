//! A map in one file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::block::BlockSource;
use crate::block_cache::BlockCache;
use crate::content_hash::ContentHash;
use crate::pam::find_pam;
use crate::windowed::read_window;
use crate::world_file::{find_prj, find_world_file};
use crate::{GeoError, Georeference, Raster, RasterPatch, WindowPx};

/// A map in one file.
pub(crate) struct SingleMap {
    path: PathBuf,
    source: Box<dyn BlockSource>,
    kind: String,
    georeference: Georeference,
    hash: ContentHash,
    cache: Arc<BlockCache>,
    caveats: Vec<String>,
}

impl SingleMap {
    /// A map with its content.
    pub fn new(
        path: &Path,
        source: Box<dyn BlockSource>,
        kind: String,
        georeference: Georeference,
        hash: ContentHash,
        cache: Arc<BlockCache>,
    ) -> Self {
        Self {
            path: path.to_path_buf(),
            source,
            kind,
            georeference,
            hash,
            cache,
            caveats: Vec::new(),
        }
    }

    /// The map with what may be wrong with it, a sentence each.
    pub fn with_caveats(mut self, caveats: impl IntoIterator<Item = String>) -> Self {
        self.caveats.extend(caveats);
        self
    }
}

impl Raster for SingleMap {
    fn size_px(&self) -> (u64, u64) {
        let full = self.source.levels()[0];
        (full.width, full.height)
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
        let mut files = self.hash.files().to_vec();
        // Not a folder: a pack may be built into it.
        if !self.path.is_dir() && !files.contains(&self.path) {
            files.push(self.path.clone());
        }
        with_descriptions(&files)
    }

    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        read_window(self.source.as_ref(), 0, &self.cache, window, out_w, out_h)
    }

    fn describe(&self) -> String {
        describe(&self.path, self, &self.kind)
    }

    fn caveats(&self) -> Vec<String> {
        self.caveats.clone()
    }
}

/// Files of a map, each followed by those beside it that describe it.
fn with_descriptions(files: &[PathBuf]) -> Vec<PathBuf> {
    let beside = |file: &PathBuf| {
        [
            Some(file.clone()),
            find_world_file(file),
            find_pam(file),
            find_prj(file),
        ]
    };
    files.iter().flat_map(beside).flatten().collect()
}

/// A description in one line: name, size, coordinate system, resolution, and `kind`.
pub(crate) fn describe(path: &Path, map: &dyn Raster, kind: &str) -> String {
    let (w, h) = map.size_px();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let georeference = map.georeference();
    let resolution = match georeference.ground_resolution_m(georeference.centre_px()) {
        Ok((x, y)) => format!("{x:.3} x {y:.3} m per pixel"),
        Err(_) => "resolution unknown".to_string(),
    };
    format!(
        "{name}: {w} x {h} pixels, {}, {resolution}; {kind}",
        georeference.crs()
    )
}
