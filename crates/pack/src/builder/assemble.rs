//! Assembles the pack from a finished journal.

use grimnet_output::Journal;

use crate::builder::finished_level::FinishedLevel;
use crate::builder::index_build::{BuiltIndex, write_index};
use crate::builder::keypoint_index_build::write_keypoint_index;
use crate::builder::recipe::Recipe;
use crate::builder::tile_descriptors::TileDescriptors;
use crate::error::Result;
use crate::format::{TileEntry, UnitEntry};
use crate::level::{CELL_PX, TILE_PX};
use crate::local_descriptors::DescriptorType;
use crate::manifest::{LevelManifest, Manifest};
use crate::quantise::{descriptor_scale, quantise_row};
use crate::writer::Writer;

/// Writes the pack.
///
/// # Errors
/// Returns an error if a file cannot be read or written, or if the options choose an index that cannot be trained.
pub fn write_pack(
    mut writer: Writer,
    journal: &mut Journal,
    levels: Vec<FinishedLevel>,
    mut manifest: Manifest,
    recipe: &dyn Recipe,
) -> Result<()> {
    for (number, level) in levels.into_iter().enumerate() {
        let entry = write_level(&mut writer, journal, level, number, &manifest, recipe)?;
        manifest.levels.push(entry);
    }
    writer.finish(manifest)
}

/// Writes the global descriptors of a level's tiles, and their scales if they are quantised.
fn write_descriptors(
    writer: &mut Writer,
    descriptors: &mut TileDescriptors<'_>,
    number: usize,
    dim: usize,
    recipe: &dyn Recipe,
) -> Result<()> {
    let mut scales = Vec::new();
    writer.begin(format!("{number}/globals"))?;
    descriptors.for_each_batch(|_, batch| {
        if recipe.descriptor_type() == DescriptorType::Float32 {
            return writer.write(bytemuck::cast_slice(batch));
        }
        for row in batch.chunks_exact(dim) {
            let (bytes, scale) = quantise_row(row);
            writer.write(bytemuck::cast_slice(&bytes))?;
            scales.push(scale);
        }
        Ok(())
    })?;
    writer.section(
        format!("{number}/global_scales"),
        bytemuck::cast_slice(&scales),
    )
}

fn write_level(
    writer: &mut Writer,
    journal: &mut Journal,
    mut level: FinishedLevel,
    number: usize,
    manifest: &Manifest,
    recipe: &dyn Recipe,
) -> Result<LevelManifest> {
    level.tiles.sort_by_key(|(tile, _)| (tile.row, tile.column));
    let units = write_features(writer, journal, &level, number)?;
    writer.section(
        format!("{number}/units"),
        bytemuck::cast_slice(&units.entries),
    )?;
    let places: Vec<TileEntry> = level.tiles.iter().map(|(tile, _)| *tile).collect();
    writer.section(format!("{number}/tiles"), bytemuck::cast_slice(&places))?;

    let dim = manifest.model.global_dim;
    let mut descriptors = TileDescriptors::new(journal, &level.tiles, dim);
    if recipe.centres_descriptors() {
        descriptors.centre()?;
    }
    write_descriptors(writer, &mut descriptors, number, dim, recipe)?;
    let adapted_from_tiles = match &level.statistics {
        Some((bytes, tiles)) => {
            writer.section(format!("{number}/statistics"), bytes)?;
            *tiles
        }
        None => 0,
    };
    let BuiltIndex {
        index,
        note: index_note,
        recall_at_10: index_recall_at_10,
    } = write_index(
        writer,
        &mut descriptors,
        number,
        manifest.options.index,
        recipe,
    )?;
    let keypoint_index = write_keypoint_index(
        writer,
        journal,
        &level,
        number,
        (units.keypoints, manifest.model.descriptor_dim),
        &manifest.options,
        recipe,
    )?;
    let plan = &level.plan;
    let tiles = places.len() as u64;
    let unit_places = u64::from(plan.layout.unit_grid[0]) * u64::from(plan.layout.unit_grid[1]);
    Ok(LevelManifest {
        frame: plan.frame,
        origin_px: plan.layout.origin_px,
        tile_px: TILE_PX,
        stride_px: CELL_PX,
        network_px: plan.layout.network_px,
        tile_grid: plan.layout.tile_grid,
        unit_grid: plan.layout.unit_grid,
        units_per_tile_side: recipe.units_per_tile_side(),
        tiles,
        tiles_skipped: plan.grid_tiles() - tiles,
        units: units.computed,
        units_skipped: unit_places - units.computed,
        keypoints: units.keypoints,
        keypoints_per_unit: level.keypoints_per_unit,
        descriptor_type: recipe.descriptor_type(),
        descriptor_scale: descriptor_scale(manifest.model.descriptor_dim),
        adapted_from_tiles,
        index,
        index_note,
        index_recall_at_10,
        keypoint_index,
    })
}

struct Units {
    entries: Vec<UnitEntry>,
    computed: u64,
    keypoints: u64,
}

fn write_features(
    writer: &mut Writer,
    journal: &mut Journal,
    level: &FinishedLevel,
    number: usize,
) -> Result<Units> {
    let grid = level.plan.layout.unit_grid;
    let entries = vec![UnitEntry::default(); grid[0] as usize * grid[1] as usize];
    let mut units = Units {
        entries,
        computed: 0,
        keypoints: 0,
    };
    writer.begin_blocks(format!("{number}/features"))?;
    level.for_each_unit(journal, |[column, row], head, blob| {
        let unit = row as usize * grid[0] as usize + column as usize;
        units.entries[unit] = UnitEntry {
            offset: writer.section_len(),
            keypoints: head.keypoints,
            state: head.state,
        };
        units.computed += u64::from(head.state);
        units.keypoints += u64::from(head.keypoints);
        writer.write(blob)
    })?;
    Ok(units)
}
