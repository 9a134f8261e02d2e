//! What the two modes of building do differently.

use grimnet_geo::{Georeference, LevelFrame, RasterPatch};
use grimnet_net::{ExtractOptions, Extractor, Model, NetSpec};
use image::{GrayImage, RgbImage};

use crate::builder::frontier::Frontier;
use crate::builder::level_plan::{Item, Layout, LevelPlan, LevelWindow};
use crate::builder::record::Record;
use crate::builder::unit::Unit;
use crate::error::Result;
use crate::index::Index;
use crate::local_descriptors::DescriptorType;
use crate::options::BuildOptions;

/// How maps are divided into tiles and feature units, how units are computed, and how tiles get their descriptors.
/// [`crate::builder::cells::Cells`] is the default mode, [`crate::paper::PaperTiles`] the paper's.
pub trait Recipe: Sync {
    /// The levels of [`crate::Levels::Auto`] over a map of `map_px` pixels, finest first.
    ///
    /// # Errors
    /// Returns an error if the map's centre has no position on Earth.
    fn auto_frames(
        &self,
        georeference: &Georeference,
        map_px: (u64, u64),
        options: &BuildOptions,
    ) -> Result<Vec<LevelFrame>>;

    /// Maximum number of levels.
    fn most_levels(&self) -> usize {
        usize::MAX
    }

    /// Divides a level of `size_px` pixels.
    ///
    /// # Errors
    /// Returns why this is impossible, as a phrase about the map.
    fn layout(&self, size_px: [u64; 2]) -> std::result::Result<Layout, String>;

    /// Columns and rows of units in one piece of work.
    fn units_per_item(&self, spec: &NetSpec) -> [u32; 2];

    /// Units along the side of a tile.
    fn units_per_tile_side(&self) -> u32;

    /// Maximum number of keypoints of a unit.
    fn max_keypoints(&self, spec: &NetSpec, options: &BuildOptions) -> u32;

    /// The pixels that an item is computed from.
    fn item_window(&self, plan: &LevelPlan, item: &Item) -> LevelWindow;

    /// Computes the units of an item, row by row, from the pixels of [`Recipe::item_window`].
    ///
    /// # Errors
    /// Returns an error if the network refuses its input.
    fn compute_item(
        &self,
        extractor: &Extractor,
        extract: &ExtractOptions,
        plan: &LevelPlan,
        item: &Item,
        patch: &RasterPatch,
    ) -> Result<Vec<Unit>>;

    /// Number of tiles of the grid, skipped ones included, that are complete with an item.
    fn tiles_completed_by(&self, item: &Item) -> u64;

    /// Adds to `record` the tiles that an item completes, their descriptors, and what later items need of it.
    fn complete_tiles(
        &self,
        model: &Model,
        plan: &LevelPlan,
        item: &Item,
        units: &[Unit],
        frontier: &mut Frontier,
        record: &mut Record,
    );

    /// Restores `frontier` to its state after an item that an earlier run finished. `None` if the record does not hold
    /// what is needed.
    fn restore(
        &self,
        plan: &LevelPlan,
        item: &Item,
        record: &Record,
        frontier: &mut Frontier,
    ) -> Option<()>;

    /// The image and mask of one tile as the network sees them.
    fn network_image(&self, rgb: RgbImage, mask: GrayImage) -> (RgbImage, GrayImage);

    /// Whether the mean of a level's tile descriptors is subtracted from each.
    fn centres_descriptors(&self) -> bool;

    /// How descriptors are stored.
    fn descriptor_type(&self) -> DescriptorType {
        DescriptorType::Int8
    }

    /// The index of a level of `tiles` tiles with descriptors of `dim` numbers, if the options do not choose one.
    fn default_index(&self, tiles: usize, dim: usize) -> Index;
}
