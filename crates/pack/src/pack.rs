//! Opens a pack: checks it and gives access to its levels.

use std::path::Path;
use std::sync::Arc;

use grimnet_geo::Georeference;
use grimnet_net::Model;

use crate::error::{PackError, Result};
use crate::file::PackFile;
use crate::layout::{check_places, read_manifest};
use crate::level::Level;
use crate::manifest::Manifest;
use crate::manifest_check::check_manifest;
use crate::mode::Mode;
use crate::printable::Printable;
use grimnet_limits::PackLimits;

/// A map pack. Cheap to clone.
///
/// Everything but large features is copied into memory when the pack is opened and compared with its checksums.
/// Features above [`PackLimits::copy_features_bytes`] stay in the file, which is mapped: above
/// [`PackLimits::verify_at_open_bytes`] they are verified block by block when they are first used. Replacing the file
/// by renaming another one over it does not disturb an open pack. If a mapped file is truncated or overwritten in
/// place, reading features returns [`PackError::Changed`] or [`PackError::Corrupt`]; only if this happens in the moment
/// between the check and the access does the system end the process (SIGBUS).
#[derive(Clone, Debug)]
pub struct Pack {
    file: Arc<PackFile>,
    manifest: Arc<Manifest>,
    levels: Arc<[Level]>,
}

impl Pack {
    /// Opens a pack with the default limits.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, is not a pack, is truncated, damaged, empty or of another format
    /// version; the message says what to do.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path, &PackLimits::default())
    }

    /// Opens a pack.
    ///
    /// # Errors
    /// As [`Pack::open`], and [`PackError::TooLarge`] if a limit is exceeded.
    pub fn open_with(path: impl AsRef<Path>, limits: &PackLimits) -> Result<Self> {
        let path = path.as_ref();
        let file = Arc::new(PackFile::open(path)?);
        let manifest = read_manifest(&file)?;
        check_places(&file, &manifest, limits)?;
        check_manifest(path, &manifest)?;
        let is_mapped = manifest
            .sections
            .iter()
            .any(|s| s.block_len.is_some() && s.len > limits.copy_features_bytes);
        let map = is_mapped.then(|| file.map()).transpose()?.map(Arc::new);
        let georeference = Arc::new(manifest.map.georeference.clone());
        let levels = (0..manifest.levels.len())
            .map(|i| Level::open(&file, map.as_ref(), &manifest, &georeference, i, limits))
            .collect::<Result<Vec<_>>>()?;
        if levels.iter().all(|level| level.tile_count() == 0) {
            return Err(PackError::corrupt(path, "it has no tiles"));
        }
        Ok(Self {
            file,
            manifest: Arc::new(manifest),
            levels: levels.into(),
        })
    }

    /// Checks that the pack was built with `model`.
    ///
    /// # Errors
    /// Returns [`PackError::ModelMismatch`] for another model, [`PackError::Corrupt`] if the pack has the model's hash
    /// and descriptors of other dimensions.
    pub fn check_model(&self, model: &Model) -> Result<()> {
        let hash = model.hash().to_string();
        let summary = &self.manifest.model;
        if hash != summary.hash {
            let short = |hash: &str| hash.chars().take(12).collect::<String>();
            return Err(PackError::ModelMismatch {
                path: self.path().to_path_buf(),
                pack_model: Printable(&summary.preset).to_string(),
                pack_hash: Printable(&short(&summary.hash)).to_string(),
                model: model.spec().preset.clone(),
                model_hash: short(&hash),
            });
        }
        let spec = model.spec();
        let (expected, found) = (
            [spec.descriptor_dim, spec.global_len()],
            [summary.descriptor_dim, summary.global_dim],
        );
        if expected != found {
            return Err(PackError::corrupt(
                self.path(),
                format!(
                    "descriptors have {} and {} dimensions, those of its model {} and {}",
                    found[0], found[1], expected[0], expected[1]
                ),
            ));
        }
        Ok(())
    }

    pub(crate) fn file(&self) -> &PackFile {
        &self.file
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Bytes of the file.
    pub fn len_bytes(&self) -> u64 {
        self.file.len()
    }

    /// The manifest of the pack.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The mode that the pack was built in.
    pub fn mode(&self) -> Mode {
        self.manifest.mode
    }

    /// The map's affine transform and coordinate system.
    pub fn georeference(&self) -> &Georeference {
        &self.manifest.map.georeference
    }

    /// Levels, finest first.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Index of the level whose ground resolution is nearest to `gsd_m` by ratio, among those with tiles.
    pub fn nearest_level(&self, gsd_m: f64) -> usize {
        let distance = |i: &usize| (self.levels[*i].gsd_m() / gsd_m).ln().abs();
        (0..self.levels.len())
            .filter(|&i| self.levels[i].tile_count() > 0)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap_or(0)
    }
}
