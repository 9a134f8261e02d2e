//! The sections of a level that are copied into memory, and the checks of what they hold.

use crate::error::{PackError, Result};
use crate::file::{AlignedBytes, PackFile};
use crate::format::{BlobLayout, TileEntry, UnitEntry, blocks_name};
use crate::global_rows::GlobalRows;
use crate::index::Index;
use crate::layout::copy_section;
use crate::local_descriptors::DescriptorType;
use crate::manifest::{LevelManifest, Manifest, Section};
use crate::search::ivf_pq::IvfPqView;
use crate::search::keypoint_index::KeypointIndex;

/// The sections of a level that are copied into memory.
#[derive(Debug)]
pub(crate) struct Tables {
    tiles: AlignedBytes,
    units: AlignedBytes,
    globals: AlignedBytes,
    global_scales: AlignedBytes,
    statistics: Option<AlignedBytes>,
    ivf_lists: Option<IvfTables>,
    keypoint_index: Option<KeypointTables>,
}

#[derive(Debug)]
struct IvfTables {
    centroids: AlignedBytes,
    codebooks: AlignedBytes,
    list_starts: AlignedBytes,
    ids: AlignedBytes,
    codes: AlignedBytes,
}

#[derive(Debug)]
struct KeypointTables {
    centroids: AlignedBytes,
    list_starts: AlignedBytes,
    positions: AlignedBytes,
    codes: AlignedBytes,
}

fn find<'a>(file: &PackFile, pack: &'a Manifest, level: usize, name: &str) -> Result<&'a Section> {
    let name = format!("{level}/{name}");
    pack.section(&name)
        .ok_or_else(|| PackError::corrupt(file.path(), format!("section {name} is missing")))
}

/// The features section of a level, and its block hashes, which are verified.
///
/// # Errors
/// Returns an error if a section is missing or damaged.
pub(crate) fn features_of<'a>(
    file: &PackFile,
    pack: &'a Manifest,
    level: usize,
) -> Result<(&'a Section, AlignedBytes)> {
    let features = find(file, pack, level, "features")?;
    let hashes = find(file, pack, level, &blocks_name("features"))?;
    if features.block_len.is_none()
        || hashes.block_len.is_some()
        || features.blake3 != hashes.blake3
    {
        return Err(PackError::corrupt(
            file.path(),
            format!("level {level}: features without block hashes"),
        ));
    }
    Ok((features, copy_section(file, hashes)?))
}

impl Tables {
    /// Copies the tables of a level and compares them with their checksums.
    ///
    /// # Errors
    /// Returns an error if a section is missing or damaged.
    pub fn open(file: &PackFile, pack: &Manifest, level: usize) -> Result<Self> {
        let table = |name: &str| copy_section(file, find(file, pack, level, name)?);
        let ivf_lists = match pack.levels[level].index {
            Index::Exact => None,
            Index::IvfPq { .. } => Some(IvfTables {
                centroids: table("ivf.centroids")?,
                codebooks: table("ivf.codebooks")?,
                list_starts: table("ivf.list_starts")?,
                ids: table("ivf.ids")?,
                codes: table("ivf.codes")?,
            }),
        };
        let keypoint_index = match pack.levels[level].keypoint_index {
            None => None,
            Some(_) => Some(KeypointTables {
                centroids: table("keypoints.centroids")?,
                list_starts: table("keypoints.list_starts")?,
                positions: table("keypoints.positions")?,
                codes: table("keypoints.codes")?,
            }),
        };
        let has_statistics = pack.section(&format!("{level}/statistics")).is_some();
        Ok(Self {
            tiles: table("tiles")?,
            units: table("units")?,
            globals: table("globals")?,
            global_scales: table("global_scales")?,
            statistics: has_statistics.then(|| table("statistics")).transpose()?,
            ivf_lists,
            keypoint_index,
        })
    }

    /// Checks lengths and references, so that no accessor can fail later.
    ///
    /// # Errors
    /// Returns what does not fit.
    pub fn check(
        &self,
        m: &LevelManifest,
        descriptor_dim: usize,
        global_dim: usize,
        features_len: u64,
    ) -> std::result::Result<(), String> {
        let wrong = |what: &str| Err(what.to_owned());
        let tiles = usize::try_from(m.tiles).unwrap_or(usize::MAX);
        let units = m.unit_grid[0] as usize * m.unit_grid[1] as usize;
        let numbers = tiles.checked_mul(global_dim);
        let (globals_fit, are_finite) = match self.globals(m.descriptor_type) {
            GlobalRows::Int8 { rows, scales } => (
                scales.len() == tiles && Some(rows.len()) == numbers,
                scales.iter().all(|s| s.is_finite()),
            ),
            GlobalRows::Float32(rows) => (
                self.global_scales.as_slice().is_empty() && Some(rows.len()) == numbers,
                rows.iter().all(|v| v.is_finite()),
            ),
        };
        if self.tiles().len() != tiles || self.units().len() != units || !globals_fit {
            return wrong("sections of the wrong length");
        }
        if !are_finite {
            return wrong("a tile descriptor or its quantisation scale that is not finite");
        }
        let in_grid = |t: &TileEntry| t.column < m.tile_grid[0] && t.row < m.tile_grid[1];
        if !self.tiles().iter().all(in_grid) {
            return wrong("a tile outside the grid");
        }
        let by_row = |t: &TileEntry| (t.row, t.column);
        let is_sorted = |pair: &[TileEntry]| by_row(&pair[0]) < by_row(&pair[1]);
        if !self.tiles().windows(2).all(is_sorted) {
            return wrong("tiles that are not in order");
        }
        let mut keypoints = 0u64;
        for unit in self.units() {
            if unit.keypoints > m.keypoints_per_unit {
                return Err(format!(
                    "a unit of {} keypoints, more than {}",
                    unit.keypoints, m.keypoints_per_unit
                ));
            }
            keypoints += u64::from(unit.keypoints);
            let end = descriptor_dim
                .checked_mul(m.descriptor_type.number_len())
                .and_then(|len| BlobLayout::new(unit.keypoints as usize, len))
                .and_then(|layout| unit.offset.checked_add(layout.stored_len() as u64));
            if end.is_none_or(|end| end > features_len) || unit.offset % 64 != 0 {
                return wrong("features outside their section");
            }
        }
        if keypoints != m.keypoints {
            return Err(format!(
                "{keypoints} keypoints; the manifest says {}",
                m.keypoints
            ));
        }
        if self.ivf_lists.is_some() && self.ivf_pq(m.index, global_dim).is_none() {
            return wrong("the index does not fit the tiles");
        }
        if self.keypoint_index.is_some() && self.keypoint_index(m, descriptor_dim).is_none() {
            return wrong("the index of the keypoints does not fit them");
        }
        Ok(())
    }

    /// Tiles with a descriptor, row by row.
    pub fn tiles(&self) -> &[TileEntry] {
        self.tiles.numbers()
    }

    /// Feature units, row by row.
    pub fn units(&self) -> &[UnitEntry] {
        self.units.numbers()
    }

    /// Tile descriptors, which are stored as `kind`.
    pub fn globals(&self, kind: DescriptorType) -> GlobalRows<'_> {
        match kind {
            DescriptorType::Int8 => GlobalRows::Int8 {
                rows: self.globals.numbers(),
                scales: self.global_scales.numbers(),
            },
            DescriptorType::Float32 => GlobalRows::Float32(self.globals.numbers()),
        }
    }

    /// Adapted statistics, if any.
    pub fn statistics(&self) -> Option<&[u8]> {
        self.statistics.as_ref().map(AlignedBytes::as_slice)
    }

    /// The IVF-PQ index. `None` if there is none or its parts do not fit.
    pub fn ivf_pq(&self, index: Index, global_dim: usize) -> Option<IvfPqView<'_>> {
        let Index::IvfPq {
            nlist,
            subquantisers,
            ..
        } = index
        else {
            return None;
        };
        let tables = self.ivf_lists.as_ref()?;
        IvfPqView::new(
            global_dim,
            nlist as usize,
            subquantisers as usize,
            self.tiles().len(),
            tables.centroids.numbers(),
            tables.codebooks.numbers(),
            tables.list_starts.numbers(),
            tables.ids.numbers(),
            tables.codes.as_slice(),
        )
    }

    /// The index of the keypoints. `None` if there is none or its parts do not fit.
    pub fn keypoint_index(
        &self,
        m: &LevelManifest,
        descriptor_dim: usize,
    ) -> Option<KeypointIndex<'_>> {
        let (shape, tables) = (m.keypoint_index?, self.keypoint_index.as_ref()?);
        KeypointIndex::new(
            (
                descriptor_dim,
                shape.lists as usize,
                usize::try_from(m.keypoints).ok()?,
            ),
            m.origin_px,
            tables.centroids.numbers(),
            tables.list_starts.numbers(),
            tables.positions.numbers(),
            tables.codes.numbers(),
        )
    }
}
