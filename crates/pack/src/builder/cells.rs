//! The default mode: features once per cell of 256 px, tiles of 2 x 2 cells that overlap by half.

use grimnet_geo::{Georeference, LevelFrame, RasterPatch};
use grimnet_net::{Dense, ExtractOptions, Extractor, Model, NetSpec, VladSum};
use image::{GrayImage, RgbImage};
use rayon::prelude::*;

use crate::builder::frontier::{CellSum, Frontier};
use crate::builder::level_plan::{Item, Layout, LevelPlan, LevelWindow};
use crate::builder::recipe::Recipe;
use crate::builder::record::Record;
use crate::builder::resolutions::auto_gsds_m;
use crate::builder::unit::{Unit, UsablePx};
use crate::builder::usable::{MIN_USABLE_OF_CELL, mask_if_partial, usable_mask, usable_px};
use crate::error::Result;
use crate::index::Index;
use crate::level::{CELL_PX, TILE_PX};
use crate::options::BuildOptions;

/// Pixels around a block that the network sees as well, so that features at its border have their surroundings.
const HALO_PX: u32 = 64;

/// Maximum bytes of a cell in the pack, its share of tile descriptors and tables included.
const CELL_BUDGET_BYTES: usize = 40 << 10;

/// Bytes of a cell that are neither features nor tile descriptors: unit and tile entries, scale, padding, index.
const CELL_OVERHEAD_BYTES: usize = 256;

/// Levels with more tiles get an IVF-PQ index: below, exact search takes milliseconds.
const MAX_TILES_FOR_EXACT: usize = 100_000;

/// Lists visited, and candidates per result that are ranked again.
const DEFAULT_NPROBE: u32 = 32;
const DEFAULT_RERANK_FACTOR: u32 = 4;

/// Cells along the side of a block: one network pass computes the features of this many squared. Larger blocks waste
/// less on their halo; networks that are wide at full resolution get smaller blocks, to stay below a gigabyte.
fn block_cells(spec: &NetSpec) -> u32 {
    const WIDE: usize = 16;
    if spec.widest_per_pixel() <= WIDE {
        4
    } else {
        3
    }
}

/// The default mode.
#[derive(Clone, Copy, Debug)]
pub struct Cells;

impl Recipe for Cells {
    fn auto_frames(
        &self,
        georeference: &Georeference,
        map_px: (u64, u64),
        options: &BuildOptions,
    ) -> Result<Vec<LevelFrame>> {
        let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
        let map_m = [map_px.0 as f64 * x_m, map_px.1 as f64 * y_m];
        auto_gsds_m((x_m * y_m).sqrt(), map_m, options.max_tile_m)
            .into_iter()
            .map(|gsd_m| Ok(LevelFrame::new(georeference, map_px, gsd_m)?))
            .collect()
    }

    fn layout(&self, size_px: [u64; 2]) -> std::result::Result<Layout, String> {
        // Whole cells, the padding shared between both sides: nothing of the map is lost, and a tile at the border is
        // never less than three quarters map.
        let cells = size_px.map(|s| (s.div_ceil(u64::from(CELL_PX)) as u32).max(2));
        let padding = |a: usize| (u64::from(cells[a]) * u64::from(CELL_PX) - size_px[a]) as i64;
        Ok(Layout {
            origin_px: [-padding(0) / 2, -padding(1) / 2],
            network_px: TILE_PX,
            tile_grid: cells.map(|c| c - 1),
            unit_grid: cells,
        })
    }

    fn units_per_item(&self, spec: &NetSpec) -> [u32; 2] {
        [block_cells(spec); 2]
    }

    fn units_per_tile_side(&self) -> u32 {
        TILE_PX / CELL_PX
    }

    fn max_keypoints(&self, spec: &NetSpec, options: &BuildOptions) -> u32 {
        let bytes_per_keypoint = spec.descriptor_dim + 6;
        let room = CELL_BUDGET_BYTES.saturating_sub(spec.global_len() + CELL_OVERHEAD_BYTES)
            / bytes_per_keypoint;
        options.max_keypoints.min(room.max(1) as u32)
    }

    fn item_window(&self, plan: &LevelPlan, item: &Item) -> LevelWindow {
        LevelWindow {
            origin_px: plan
                .unit_origin_px(item.first)
                .map(|v| v - i64::from(HALO_PX)),
            size_px: item.count.map(|count| count * CELL_PX + 2 * HALO_PX),
        }
    }

    /// One dense pass for all cells of a block.
    fn compute_item(
        &self,
        extractor: &Extractor,
        extract: &ExtractOptions,
        plan: &LevelPlan,
        item: &Item,
        patch: &RasterPatch,
    ) -> Result<Vec<Unit>> {
        let mask = usable_mask(patch);
        let count = item.count[0] * item.count[1];
        let cell = |i: u32| [i % item.count[0], i / item.count[0]];
        let corner = |i: u32| cell(i).map(|v| HALO_PX + v * CELL_PX);
        let usable: Vec<UsablePx> = (0..count)
            .map(|i| {
                let [x, y] = corner(i);
                let [column, row] = cell(i);
                let origin = plan.unit_origin_px([item.first[0] + column, item.first[1] + row]);
                UsablePx {
                    usable: usable_px(&mask, x, y, CELL_PX),
                    inside: plan.inside_px(origin, CELL_PX),
                }
            })
            .collect();
        let is_enough = |counts: &UsablePx| counts.is_enough(MIN_USABLE_OF_CELL);
        if !usable.iter().any(is_enough) {
            return Ok(usable.iter().map(|counts| Unit::skipped(*counts)).collect());
        }
        let mask = mask_if_partial(&mask);
        let dense: Dense = extractor.dense(&patch.rgb, mask)?;
        usable
            .par_iter()
            .enumerate()
            .map(|(i, counts)| {
                if !is_enough(counts) {
                    return Ok(Unit::skipped(*counts));
                }
                let [x, y] = corner(i as u32);
                let window = [x, y, CELL_PX, CELL_PX];
                let keypoints = dense.keypoints(window, extract, mask);
                let descriptors = dense.describe(&keypoints);
                let dim = extractor.model().spec().descriptor_dim;
                let kind = self.descriptor_type();
                let mut unit = Unit::computed(*counts, &keypoints, [x, y], &descriptors, dim, kind);
                unit.vlad = Some(dense.vlad(window, mask).as_slice().to_vec());
                Ok(unit)
            })
            .collect()
    }

    fn tiles_completed_by(&self, item: &Item) -> u64 {
        // The first row and column of cells complete no tile.
        let along = |a: usize| u64::from(item.count[a] - u32::from(item.first[a] == 0));
        along(0) * along(1)
    }

    fn complete_tiles(
        &self,
        model: &Model,
        plan: &LevelPlan,
        item: &Item,
        units: &[Unit],
        frontier: &mut Frontier,
        record: &mut Record,
    ) {
        for (i, unit) in units.iter().enumerate() {
            if let (true, Some(sum)) = (Frontier::is_kept(plan, item, i), &unit.vlad) {
                record.kept.push(i as u32);
                record.sums.extend_from_slice(sum);
            }
        }
        let cells = units.iter().map(|unit| CellSum {
            vlad: unit.vlad.clone(),
            usable_px: unit.head.usable_px,
            inside_px: unit.head.inside_px,
        });
        let complete = frontier.complete(item, cells.collect());
        let (places, sums): (Vec<_>, Vec<_>) = complete
            .into_iter()
            .filter_map(|tile| Some((tile.place, VladSum::from_vec(tile.vlad?))))
            .unzip();
        record.tiles = places;
        record.globals = model.global_descriptors(&sums);
    }

    fn restore(
        &self,
        plan: &LevelPlan,
        item: &Item,
        record: &Record,
        frontier: &mut Frontier,
    ) -> Option<()> {
        let len = record
            .sums
            .len()
            .checked_div(record.kept.len())
            .unwrap_or(0);
        let sum = |unit: usize| {
            let at = record.kept.iter().position(|&k| k as usize == unit)?;
            Some(record.sums[at * len..(at + 1) * len].to_vec())
        };
        let kept = record
            .units
            .iter()
            .enumerate()
            .filter(|(i, _)| Frontier::is_kept(plan, item, *i))
            .map(|(i, head)| {
                let cell = CellSum {
                    vlad: sum(i),
                    usable_px: head.usable_px,
                    inside_px: head.inside_px,
                };
                (i, cell)
            });
        frontier.restore(item, kept.collect::<Vec<_>>());
        Some(())
    }

    fn network_image(&self, rgb: RgbImage, mask: GrayImage) -> (RgbImage, GrayImage) {
        (rgb, mask)
    }

    fn centres_descriptors(&self) -> bool {
        true
    }

    fn default_index(&self, tiles: usize, dim: usize) -> Index {
        if tiles <= MAX_TILES_FOR_EXACT {
            return Index::Exact;
        }
        Index::IvfPq {
            // About 4 sqrt(N) lists (faiss, "Guidelines to choose an index").
            nlist: (4.0 * (tiles as f64).sqrt()) as u32,
            subquantisers: if dim.is_multiple_of(64) {
                64
            } else {
                dim as u32
            },
            nprobe: DEFAULT_NPROBE,
            rerank_factor: DEFAULT_RERANK_FACTOR,
        }
    }
}
