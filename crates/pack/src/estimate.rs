//! What building a pack would take, before it is built.

use grimnet_geo::Raster;
use grimnet_net::Model;

use crate::builder::cost::bytes_per_tile;
use crate::builder::{checked_plans, recipe_of};
use crate::error::Result;
use crate::options::BuildOptions;
use grimnet_limits::BuildLimits;

/// What building a pack would take.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildEstimate {
    /// Levels, finest first.
    pub levels: Vec<LevelEstimate>,
    /// Size of the pack, bytes, if all of the map has data and as many keypoints as are kept.
    pub pack_bytes: u64,
}

/// What a level would take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelEstimate {
    /// Metres per pixel at the map's centre.
    pub gsd_m: f64,
    /// Tiles, those without data included.
    pub tiles: u64,
}

impl BuildEstimate {
    /// Tiles of all levels.
    pub fn tiles(&self) -> u64 {
        self.levels.iter().map(|level| level.tiles).sum()
    }
}

/// What [`crate::build`] would take with these options. No pixel is read.
///
/// # Errors
/// As [`crate::build`], for a map whose pixels have an implausible size, options that do not fit, and a plan above the limits.
pub fn estimate(
    raster: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    limits: &BuildLimits,
) -> Result<BuildEstimate> {
    let recipe = recipe_of(options);
    let recipe = recipe.as_ref();
    let spec = model.spec();
    let plans = checked_plans(raster, spec, options, recipe, limits)?;
    let levels: Vec<LevelEstimate> = plans
        .iter()
        .map(|plan| LevelEstimate {
            gsd_m: plan.frame.gsd_m,
            tiles: plan.grid_tiles(),
        })
        .collect();
    let pack_bytes = plans.iter().fold(0u64, |sum, plan| {
        let units: u64 = plan.layout.unit_grid.map(u64::from).iter().product();
        sum.saturating_add(units.saturating_mul(bytes_per_tile(plan, spec, options, recipe)))
    });
    Ok(BuildEstimate { levels, pack_bytes })
}
