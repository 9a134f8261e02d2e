//! How the builder makes the paper's tiles: cut at stride 256, resized, each described on its own.

use grimnet_geo::{Georeference, LevelFrame, RasterPatch};
use grimnet_net::{ExtractOptions, Extractor, Model, NetSpec};
use image::{GrayImage, RgbImage, imageops};
use rayon::prelude::*;

use super::PAPER_INDEX;
use super::network_image::resize_for_network;
use super::tile_grid::tile_grid;
use crate::builder::frontier::Frontier;
use crate::builder::level_plan::{Item, Layout, LevelPlan, LevelWindow};
use crate::builder::recipe::Recipe;
use crate::builder::record::Record;
use crate::builder::unit::{Unit, UsablePx};
use crate::builder::usable::{MIN_USABLE_OF_TILE, mask_if_partial, usable_mask, usable_px};
use crate::error::Result;
use crate::format::TileEntry;
use crate::index::Index;
use crate::level::{CELL_PX, TILE_PX};
use crate::local_descriptors::DescriptorType;
use crate::options::BuildOptions;

/// Distance between neighbouring tiles, level pixels (section 3.2).
const STRIDE_PX: u32 = CELL_PX;

/// Tiles in one piece of work.
const TILES_PER_ITEM: u32 = 8;

/// Paper mode.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PaperTiles {
    /// Side of the image that a tile is resized to, pixels.
    pub resolution_px: u32,
}

impl PaperTiles {
    fn compute_tile(
        &self,
        extractor: &Extractor,
        extract: &ExtractOptions,
        counts: UsablePx,
        rgb: RgbImage,
        mask: GrayImage,
    ) -> Result<Unit> {
        let (rgb, mask) = self.network_image(rgb, mask);
        let features = extractor.extract(&rgb, mask_if_partial(&mask), extract)?;
        let mut unit = Unit::computed(
            counts,
            &features.keypoints,
            [0, 0],
            &features.descriptors,
            features.descriptor_dim,
            self.descriptor_type(),
        );
        unit.global = Some(features.global);
        Ok(unit)
    }
}

impl Recipe for PaperTiles {
    /// The map's own pixels, whatever their shape.
    fn auto_frames(
        &self,
        georeference: &Georeference,
        map_px: (u64, u64),
        _options: &BuildOptions,
    ) -> Result<Vec<LevelFrame>> {
        Ok(vec![LevelFrame::of_map_pixels(georeference, map_px)?])
    }

    fn most_levels(&self) -> usize {
        1
    }

    fn layout(&self, size_px: [u64; 2]) -> std::result::Result<Layout, String> {
        let grid = tile_grid(size_px, u64::from(TILE_PX), u64::from(STRIDE_PX));
        if grid == [0, 0] {
            return Err(format!(
                "smaller than a tile of {TILE_PX} px; paper mode needs a finer ground resolution, default mode pads \
                 small maps"
            ));
        }
        let tiles = grid.map(|count| count as u32);
        Ok(Layout {
            origin_px: [0, 0],
            network_px: self.resolution_px,
            tile_grid: tiles,
            unit_grid: tiles,
        })
    }

    fn units_per_item(&self, _spec: &NetSpec) -> [u32; 2] {
        [TILES_PER_ITEM, 1]
    }

    fn units_per_tile_side(&self) -> u32 {
        1
    }

    fn max_keypoints(&self, _spec: &NetSpec, options: &BuildOptions) -> u32 {
        options.max_keypoints
    }

    fn item_window(&self, plan: &LevelPlan, item: &Item) -> LevelWindow {
        LevelWindow {
            origin_px: plan.unit_origin_px(item.first),
            size_px: item.count.map(|count| (count - 1) * STRIDE_PX + TILE_PX),
        }
    }

    fn compute_item(
        &self,
        extractor: &Extractor,
        extract: &ExtractOptions,
        plan: &LevelPlan,
        item: &Item,
        patch: &RasterPatch,
    ) -> Result<Vec<Unit>> {
        let mask = usable_mask(patch);
        (0..item.count[0])
            .into_par_iter()
            .map(|i| {
                let left = i * STRIDE_PX;
                let origin = plan.unit_origin_px([item.first[0] + i, item.first[1]]);
                let counts = UsablePx {
                    usable: usable_px(&mask, left, 0, TILE_PX),
                    inside: plan.inside_px(origin, TILE_PX),
                };
                if !counts.is_enough(MIN_USABLE_OF_TILE) {
                    return Ok(Unit::skipped(counts));
                }
                let rgb = imageops::crop_imm(&patch.rgb, left, 0, TILE_PX, TILE_PX).to_image();
                let mask = imageops::crop_imm(&mask, left, 0, TILE_PX, TILE_PX).to_image();
                self.compute_tile(extractor, extract, counts, rgb, mask)
            })
            .collect()
    }

    fn tiles_completed_by(&self, item: &Item) -> u64 {
        u64::from(item.count[0]) * u64::from(item.count[1])
    }

    fn complete_tiles(
        &self,
        _model: &Model,
        _plan: &LevelPlan,
        item: &Item,
        units: &[Unit],
        _frontier: &mut Frontier,
        record: &mut Record,
    ) {
        for (i, unit) in units.iter().enumerate() {
            if let Some(global) = &unit.global {
                record.tiles.push(TileEntry {
                    column: item.first[0] + i as u32,
                    row: item.first[1],
                });
                record.globals.extend_from_slice(global);
            }
        }
    }

    /// Tiles are independent: nothing is carried from one item to the next.
    fn restore(
        &self,
        _plan: &LevelPlan,
        _item: &Item,
        _record: &Record,
        _frontier: &mut Frontier,
    ) -> Option<()> {
        Some(())
    }

    fn network_image(&self, rgb: RgbImage, mask: GrayImage) -> (RgbImage, GrayImage) {
        let side = self.resolution_px;
        if rgb.dimensions() == (side, side) {
            return (rgb, mask);
        }
        (
            resize_for_network(&rgb, side),
            imageops::resize(&mask, side, side, imageops::FilterType::Nearest),
        )
    }

    fn centres_descriptors(&self) -> bool {
        false
    }

    fn descriptor_type(&self) -> DescriptorType {
        DescriptorType::Float32
    }

    fn default_index(&self, _tiles: usize, _dim: usize) -> Index {
        PAPER_INDEX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_as_counted_by_hand() {
        let recipe = PaperTiles { resolution_px: 320 };
        // 0, 256, 512, 768 (+512 = 1280 <= 1500); 1024 + 512 would not fit. 0, 256 (+512 = 768), 511 is short of 512.
        let layout = recipe.layout([1500, 1023]).unwrap();
        assert_eq!(layout.tile_grid, [4, 2]);
        assert_eq!((layout.origin_px, layout.network_px), ([0, 0], 320));
        let error = recipe.layout([400, 600]).unwrap_err();
        assert!(error.contains("smaller than a tile"), "{error}");
    }
}
