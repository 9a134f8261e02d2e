//! Builds and writes the keypoint index of a level.

use grimnet_output::Journal;

use crate::builder::finished_level::FinishedLevel;
use crate::builder::level_plan::LevelPlan;
use crate::builder::recipe::Recipe;
use crate::error::Result;
use crate::features::FeatureBlock;
use crate::level::CELL_PX;
use crate::local_descriptors::DescriptorType;
use crate::manifest::KeypointIndexShape;
use crate::options::BuildOptions;
use crate::quantise::descriptor_scale;
use crate::search::hamming_code::code_words;
use crate::search::inverted_lists::sort_by_list;
use crate::search::keypoint_index::{KeypointPosition, encode, lists_for, train, training_points};
use crate::writer::Writer;

/// Descriptors that are encoded at a time.
const BATCH: usize = 1 << 14;

/// Keypoints of a level above which no index is built: 2 GiB while it is.
const MAX_KEYPOINTS: u64 = 1 << 26;

/// What a keypoint takes in the index, bytes: position and code.
pub fn bytes_per_indexed_keypoint(dim: usize) -> usize {
    size_of::<KeypointPosition>() + code_words(dim) * size_of::<u64>()
}

/// Whether a level of so many tiles gets an index: in default mode, with enough tiles, if its positions have 16 bits.
pub fn has_keypoint_index(
    plan: &LevelPlan,
    tiles: u64,
    options: &BuildOptions,
    recipe: &dyn Recipe,
) -> bool {
    let side_px = plan
        .layout
        .unit_grid
        .map(|units| f64::from(units) * f64::from(CELL_PX) - 1.0);
    tiles >= u64::from(options.keypoint_index_tiles)
        && recipe.descriptor_type() == DescriptorType::Int8
        && KeypointPosition::of(side_px).is_some()
}

/// Encoded keypoints, in the order of the journal.
#[derive(Default)]
struct Entries {
    lists: Vec<u32>,
    positions: Vec<KeypointPosition>,
    codes: Vec<u64>,
}

/// Writes the index of the `keypoints` keypoints of a level, if it gets one.
///
/// # Errors
/// Returns an error if a file cannot be read or written.
pub fn write_keypoint_index(
    writer: &mut Writer,
    journal: &mut Journal,
    level: &FinishedLevel,
    number: usize,
    (keypoints, dim): (u64, usize),
    options: &BuildOptions,
    recipe: &dyn Recipe,
) -> Result<Option<KeypointIndexShape>> {
    let tiles = level.tiles.len() as u64;
    if !has_keypoint_index(&level.plan, tiles, options, recipe)
        || !(1..=MAX_KEYPOINTS).contains(&keypoints)
    {
        return Ok(None);
    }
    let lists = lists_for(keypoints);
    let scale = descriptor_scale(dim);
    let step = keypoints.div_ceil(training_points(lists) as u64) as usize;
    let mut sample = Vec::new();
    let mut seen = 0;
    for_each_keypoint(journal, level, dim, |descriptor, _| {
        if seen % step == 0 {
            sample.extend(descriptor.iter().map(|&v| f32::from(v) * scale));
        }
        seen += 1;
    })?;
    let centroids = train(&sample, dim, lists);
    drop(sample);
    let lists = centroids.len() / dim;

    let mut entries = Entries::default();
    let mut batch: Vec<f32> = Vec::with_capacity(BATCH * dim);
    let flush = |batch: &mut Vec<f32>, lists: &mut Vec<u32>, codes: &mut Vec<u64>| {
        let (of, code) = encode(&centroids, batch, dim);
        lists.extend(of);
        codes.extend(code);
        batch.clear();
    };
    for_each_keypoint(journal, level, dim, |descriptor, position| {
        entries.positions.push(position);
        batch.extend(descriptor.iter().map(|&v| f32::from(v) * scale));
        if batch.len() == BATCH * dim {
            flush(&mut batch, &mut entries.lists, &mut entries.codes);
        }
    })?;
    flush(&mut batch, &mut entries.lists, &mut entries.codes);
    write_entries(writer, &entries, &centroids, number, dim)?;
    Ok(Some(KeypointIndexShape {
        lists: lists as u32,
    }))
}

/// Writes the entries in the order of their lists.
fn write_entries(
    writer: &mut Writer,
    entries: &Entries,
    centroids: &[f32],
    number: usize,
    dim: usize,
) -> Result<()> {
    let (order, starts) = sort_by_list(&entries.lists, centroids.len() / dim);
    let name = |part: &str| format!("{number}/keypoints.{part}");
    writer.section(name("centroids"), bytemuck::cast_slice(centroids))?;
    writer.section(name("list_starts"), bytemuck::cast_slice(&starts))?;
    writer.begin(name("positions"))?;
    for &i in &order {
        writer.write(bytemuck::bytes_of(&entries.positions[i as usize]))?;
    }
    writer.begin(name("codes"))?;
    let words = code_words(dim);
    for &i in &order {
        let code = &entries.codes[i as usize * words..][..words];
        writer.write(bytemuck::cast_slice(code))?;
    }
    Ok(())
}

/// Calls `each` with descriptor and position of the keypoints of a level.
fn for_each_keypoint(
    journal: &mut Journal,
    level: &FinishedLevel,
    dim: usize,
    mut each: impl FnMut(&[i8], KeypointPosition),
) -> Result<()> {
    level.for_each_unit(journal, |unit, head, blob| {
        let keypoints = head.keypoints as usize;
        let Some(block) = FeatureBlock::new(blob, keypoints, dim, [0.0; 2], 1.0) else {
            return Ok(());
        };
        for i in 0..block.len() {
            // Pixel centres are at integers there, and half a pixel from the corner here.
            let px = block.xy_px(i).map(|along| f64::from(along) + 0.5);
            let corner_px = unit.map(|units| f64::from(units) * f64::from(CELL_PX));
            let position = KeypointPosition::of([corner_px[0] + px[0], corner_px[1] + px[1]]);
            let descriptor = bytemuck::cast_slice(block.descriptor(i));
            each(descriptor, position.unwrap_or_default());
        }
        Ok(())
    })
}
