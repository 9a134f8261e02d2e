//! Normalisation statistics recomputed on the map, without labels.

use grimnet_geo::Raster;
use grimnet_net::{Extractor, Statistics};

use crate::builder::level_plan::{LevelPlan, LevelWindow};
use crate::builder::recipe::Recipe;
use crate::builder::usable::{is_enough, usable_mask, usable_px};
use crate::error::Result;
use crate::level::{CELL_PX, TILE_PX};

/// Maximum number of tiles that statistics are computed from.
const SAMPLES: u64 = 64;

/// Tiles with a smaller share of usable pixels are left out.
const MIN_USABLE: f64 = 0.5;

/// Mean statistics over up to [`SAMPLES`] tiles spread evenly over a level, and the number of tiles. `None` if no tile
/// of the sample is usable.
///
/// # Errors
/// Returns an error if the map cannot be read or the network refuses its input.
pub fn adapted_statistics(
    raster: &dyn Raster,
    extractor: &Extractor,
    plan: &LevelPlan,
    recipe: &dyn Recipe,
) -> Result<Option<(Statistics, u32)>> {
    let tiles = plan.grid_tiles();
    let count = tiles.min(SAMPLES);
    let mut all = Vec::new();
    for i in 0..count {
        // The middle of each of `count` equal parts.
        let tile = (u128::from(2 * i + 1) * u128::from(tiles) / u128::from(2 * count)) as u64;
        let columns = u64::from(plan.layout.tile_grid[0]);
        let at = [tile % columns, tile / columns];
        let window = LevelWindow {
            origin_px: [0, 1]
                .map(|a| plan.layout.origin_px[a] + (at[a] * u64::from(CELL_PX)) as i64),
            size_px: [TILE_PX, TILE_PX],
        };
        let patch = raster.read(plan.map_window(&window), TILE_PX, TILE_PX)?;
        let mask = usable_mask(&patch);
        let area = u64::from(TILE_PX) * u64::from(TILE_PX);
        if !is_enough(usable_px(&mask, 0, 0, TILE_PX), area, MIN_USABLE) {
            continue;
        }
        let (rgb, mask) = recipe.network_image(patch.rgb, mask);
        all.push(extractor.dense_instance(&rgb, Some(&mask))?.1);
    }
    if all.is_empty() {
        return Ok(None);
    }
    Ok(Some((Statistics::mean_of(&all)?, all.len() as u32)))
}
