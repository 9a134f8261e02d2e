//! Features of one piece of work: a block of cells (default mode) or a row of tiles (paper mode).

use grimnet_geo::{LevelPx, Raster, RasterPatch, WindowPx};
use grimnet_net::{Dense, ExtractOptions, Extractor, Keypoint};
use image::{GrayImage, RgbImage, imageops};
use rayon::prelude::*;

use crate::build::bilinear::resize_bilinear;
use crate::build::frontier::CellSum;
use crate::build::plan::{HALO_PX, Item, LevelPlan};
use crate::build::record::UnitHead;
use crate::build::usable::{
    LEAST_USABLE_OF_CELL, LEAST_USABLE_OF_TILE, is_enough, usable_mask, usable_px,
};
use crate::error::Result;
use crate::features::encode_blob;
use crate::format::UnitState;
use crate::level::{CELL_PX, TILE_PX};
use crate::options::Mode;
use crate::quantise::quantise_descriptors;

/// What was computed for one unit.
#[derive(Clone, Debug, Default)]
pub struct Unit {
    /// Counts and state.
    pub head: UnitHead,
    /// Feature blob.
    pub blob: Vec<u8>,
    /// Default mode: the cell's VLAD sum.
    pub vlad: Option<Vec<f32>>,
    /// Paper mode: the tile's descriptor.
    pub global: Option<Vec<f32>>,
}

impl Unit {
    fn skipped(usable_px: u64, inside_px: u64) -> Self {
        let head = UnitHead {
            state: UnitState::Skipped as u32,
            usable_px: usable_px as u32,
            inside_px: inside_px as u32,
            ..UnitHead::default()
        };
        Self {
            head,
            ..Self::default()
        }
    }

    fn computed(
        usable_px: u64,
        inside_px: u64,
        keypoints: &[Keypoint],
        origin_px: [u32; 2],
        descriptors: &[f32],
        dim: usize,
    ) -> Self {
        let at = |k: &Keypoint| [k.x_px - origin_px[0] as f32, k.y_px - origin_px[1] as f32];
        let positions: Vec<[f32; 2]> = keypoints.iter().map(at).collect();
        let scores: Vec<f32> = keypoints.iter().map(|k| k.score).collect();
        let blob = encode_blob(&positions, &scores, &quantise_descriptors(descriptors, dim));
        let head = UnitHead {
            state: UnitState::Computed as u32,
            keypoints: keypoints.len() as u32,
            usable_px: usable_px as u32,
            inside_px: inside_px as u32,
            blob_len: blob.len() as u64,
        };
        Self {
            head,
            blob,
            vlad: None,
            global: None,
        }
    }

    /// The unit as its tiles need it.
    pub fn cell_sum(&self) -> CellSum {
        CellSum {
            vlad: self.vlad.clone(),
            usable_px: self.head.usable_px,
            inside_px: self.head.inside_px,
        }
    }
}

/// Reads the pixels that an item needs.
///
/// # Errors
/// Where the map cannot be read.
pub fn read_item(
    raster: &dyn Raster,
    plan: &LevelPlan,
    item: &Item,
    mode: Mode,
) -> Result<RasterPatch> {
    let [x, y] = plan.unit_origin_px(item.first);
    let (margin, overlap) = match mode {
        Mode::Default => (HALO_PX, 0),
        Mode::Paper => (0, TILE_PX - CELL_PX),
    };
    let side = |a: usize| item.count[a] * CELL_PX + overlap + 2 * margin;
    read_window(
        raster,
        plan,
        [x - i64::from(margin), y - i64::from(margin)],
        [side(0), side(1)],
    )
}

/// Reads a window of a level at its resolution.
///
/// # Errors
/// Where the map cannot be read.
pub fn read_window(
    raster: &dyn Raster,
    plan: &LevelPlan,
    origin_px: [i64; 2],
    size_px: [u32; 2],
) -> Result<RasterPatch> {
    let [x, y] = origin_px.map(|v| v as f64);
    let [w, h] = size_px.map(f64::from);
    let window: WindowPx = plan.frame.map_window(LevelPx::new(x, y), w, h);
    Ok(raster.read(window, size_px[0], size_px[1])?)
}

/// Computes the units of an item from its pixels.
///
/// # Errors
/// Where the network refuses.
pub fn compute_item(
    extractor: &Extractor,
    extract: &ExtractOptions,
    plan: &LevelPlan,
    item: &Item,
    patch: &RasterPatch,
    mode: Mode,
) -> Result<Vec<Unit>> {
    let mask = usable_mask(patch);
    match mode {
        Mode::Default => compute_block(extractor, extract, plan, item, &patch.rgb, &mask),
        Mode::Paper => (0..item.count[0])
            .into_par_iter()
            .map(|i| compute_paper_tile(extractor, extract, plan, item, i, &patch.rgb, &mask))
            .collect(),
    }
}

/// One dense pass for all cells of a block.
fn compute_block(
    extractor: &Extractor,
    extract: &ExtractOptions,
    plan: &LevelPlan,
    item: &Item,
    rgb: &RgbImage,
    mask: &GrayImage,
) -> Result<Vec<Unit>> {
    let count = item.count[0] * item.count[1];
    let place = |i: u32| [i % item.count[0], i / item.count[0]];
    let corner = |i: u32| place(i).map(|v| HALO_PX + v * CELL_PX);
    let usable: Vec<(u64, u64)> = (0..count)
        .map(|i| {
            let [x, y] = corner(i);
            let [column, row] = place(i);
            let origin = plan.unit_origin_px([item.first[0] + column, item.first[1] + row]);
            (
                usable_px(mask, x, y, CELL_PX),
                plan.inside_px(origin, CELL_PX),
            )
        })
        .collect();
    let worth = |&(usable, inside): &(u64, u64)| is_enough(usable, inside, LEAST_USABLE_OF_CELL);
    if !usable.iter().any(worth) {
        return Ok(usable
            .iter()
            .map(|&(usable, inside)| Unit::skipped(usable, inside))
            .collect());
    }
    let mask = partial(mask);
    let dense: Dense = extractor.dense(rgb, mask)?;
    usable
        .par_iter()
        .enumerate()
        .map(|(i, counts)| {
            if !worth(counts) {
                return Ok(Unit::skipped(counts.0, counts.1));
            }
            let [x, y] = corner(i as u32);
            let window = [x, y, CELL_PX, CELL_PX];
            let keypoints = dense.keypoints(window, extract, mask);
            let descriptors = dense.describe(&keypoints);
            let dim = extractor.model().spec().descriptor_dim;
            let mut unit =
                Unit::computed(counts.0, counts.1, &keypoints, [x, y], &descriptors, dim);
            unit.vlad = Some(dense.vlad(window, mask).as_slice().to_vec());
            Ok(unit)
        })
        .collect()
}

/// One tile of its own, resized for the network.
fn compute_paper_tile(
    extractor: &Extractor,
    extract: &ExtractOptions,
    plan: &LevelPlan,
    item: &Item,
    index: u32,
    rgb: &RgbImage,
    mask: &GrayImage,
) -> Result<Unit> {
    let left = index * CELL_PX;
    let usable = usable_px(mask, left, 0, TILE_PX);
    let inside = plan.inside_px(
        plan.unit_origin_px([item.first[0] + index, item.first[1]]),
        TILE_PX,
    );
    if !is_enough(usable, inside, LEAST_USABLE_OF_TILE) {
        return Ok(Unit::skipped(usable, inside));
    }
    let side = plan.network_px;
    let tile = resize_bilinear(
        &imageops::crop_imm(rgb, left, 0, TILE_PX, TILE_PX).to_image(),
        side,
    );
    let seen = imageops::crop_imm(mask, left, 0, TILE_PX, TILE_PX).to_image();
    let seen = imageops::resize(&seen, side, side, imageops::FilterType::Nearest);
    let features = extractor.extract(&tile, partial(&seen), extract)?;
    let mut unit = Unit::computed(
        usable,
        inside,
        &features.keypoints,
        [0, 0],
        &features.descriptors,
        features.descriptor_dim,
    );
    unit.global = Some(features.global);
    Ok(unit)
}

/// A mask that hides nothing is none.
fn partial(mask: &GrayImage) -> Option<&GrayImage> {
    mask.as_raw().contains(&0).then_some(mask)
}
