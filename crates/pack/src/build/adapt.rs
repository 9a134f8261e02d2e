//! Normalisation statistics taken anew from the map, without labels.

use grimnet_geo::Raster;
use grimnet_net::{Extractor, Statistics};
use image::imageops;

use crate::build::bilinear::resize_bilinear;
use crate::build::plan::LevelPlan;
use crate::build::unit::read_window;
use crate::build::usable::{usable_mask, usable_px};
use crate::error::Result;
use crate::level::{CELL_PX, TILE_PX};

/// Tiles that statistics are taken from.
const SAMPLES: u64 = 64;

/// Tiles with less of their pixels usable say little about the map.
const LEAST_USABLE: f64 = 0.5;

/// Mean statistics over up to [`SAMPLES`] tiles spread evenly over a level, and their number. `None` where no tile of
/// the sample is usable.
///
/// # Errors
/// Where the map cannot be read or the network refuses.
pub fn adapted_statistics(
    raster: &dyn Raster,
    extractor: &Extractor,
    plan: &LevelPlan,
) -> Result<Option<(Statistics, u32)>> {
    let places = plan.tile_places();
    let count = places.min(SAMPLES);
    let mut all = Vec::new();
    for i in 0..count {
        // The middle of each of `count` equal stretches.
        let place = (u128::from(2 * i + 1) * u128::from(places) / u128::from(2 * count)) as u64;
        let columns = u64::from(plan.tile_grid[0]);
        let at = [place % columns, place / columns];
        let origin = [0, 1].map(|a| plan.origin_px[a] + (at[a] * u64::from(CELL_PX)) as i64);
        let patch = read_window(raster, plan, origin, [TILE_PX, TILE_PX])?;
        let mask = usable_mask(&patch);
        let area = f64::from(TILE_PX) * f64::from(TILE_PX);
        if (usable_px(&mask, 0, 0, TILE_PX) as f64) < LEAST_USABLE * area {
            continue;
        }
        let statistics = if plan.network_px == TILE_PX {
            extractor.dense_instance(&patch.rgb, Some(&mask))?.1
        } else {
            let side = plan.network_px;
            let mask = imageops::resize(&mask, side, side, imageops::FilterType::Nearest);
            extractor
                .dense_instance(&resize_bilinear(&patch.rgb, side), Some(&mask))?
                .1
        };
        all.push(statistics);
    }
    if all.is_empty() {
        return Ok(None);
    }
    Ok(Some((Statistics::mean_of(&all)?, all.len() as u32)))
}
