//! What a plan would cost, compared with the limits before work starts.

use grimnet_geo::Raster;
use grimnet_net::NetSpec;

use crate::builder::keypoint_index_build::{bytes_per_indexed_keypoint, has_keypoint_index};
use crate::builder::level_plan::LevelPlan;
use crate::builder::recipe::Recipe;
use crate::error::{PackError, Result};
use crate::index::Index;
use crate::options::{BuildOptions, Levels};
use crate::search::ivf_pq::IvfPqCodec;
use grimnet_limits::{BuildLimits, PackLimits};

/// Bytes of a tile in the tables of a large pack beside its descriptor: its entry, and its row in the IVF-PQ index.
const TABLE_BYTES_BESIDE: u64 = 96;

/// Checks that the pixels of a map have a plausible size on the ground.
///
/// # Errors
/// Returns [`PackError::Scale`] if they have not, [`PackError::Map`] if the map has no position on Earth.
pub fn check_scale(raster: &dyn Raster, limits: &BuildLimits) -> Result<()> {
    let georeference = raster.georeference();
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let (min, max) = limits.map_pixel_m;
    if [x_m, y_m].iter().all(|side| (min..=max).contains(side)) {
        return Ok(());
    }
    Err(PackError::Scale {
        map: raster.describe(),
        what: format!(
            "its pixels measure {x_m} x {y_m} m on the ground, expected {min} to {max} m"
        ),
    })
}

/// A map enlarged by more than this has nothing more to show: the ground resolution is a slip of units.
const MOST_ENLARGED: f64 = 16.0;
/// A map reduced by more than this to less than a tile is a slip of units as well, unless it is of satellites.
const MOST_REDUCED: f64 = 16.0;

/// Checks that no level is far finer than the map. Warns of one that is far coarser if its resolution was given: those of
/// [`Levels::Auto`] end with a tile that shows the whole map.
///
/// # Errors
/// Returns [`PackError::Options`] if one is, [`PackError::Map`] if the map has no position on Earth.
pub fn check_enlargement(
    plans: &[LevelPlan],
    raster: &dyn Raster,
    options: &BuildOptions,
) -> Result<()> {
    let georeference = raster.georeference();
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let map_gsd_m = x_m.min(y_m);
    for plan in plans {
        let times = map_gsd_m / plan.frame.gsd_m;
        if times > MOST_ENLARGED {
            return Err(PackError::Options(format!(
                "at {:.4} m per pixel the map would be enlarged {times:.0} times: its own pixels measure {map_gsd_m:.3} m; choose a ground \
                 resolution in metres that is not far below that, or check the height and the field of view that it comes from",
                plan.frame.gsd_m
            )));
        }
        let [width, height] = plan.size_px();
        let is_given = matches!(options.levels, Levels::Gsd(_));
        if is_given
            && 1.0 / times > MOST_REDUCED
            && width.max(height) < u64::from(plan.layout.network_px)
        {
            tracing::warn!(
                "at {} m per pixel the whole map is {width} x {height} px, less than one tile, in which hardly any photo is found: its own \
                 pixels measure {map_gsd_m:.3} m; ground resolutions are in metres per pixel",
                plan.frame.gsd_m
            );
        }
    }
    Ok(())
}

/// Checks that a chosen IVF-PQ index can be trained on each level: after hours of work it is late to learn.
///
/// # Errors
/// Returns [`PackError::Index`] if a level has too few tiles even if all of them are usable, or if the subquantisers do not divide
/// its descriptors.
pub fn check_index(plans: &[LevelPlan], spec: &NetSpec, options: &BuildOptions) -> Result<()> {
    let Some(Index::IvfPq {
        nlist,
        subquantisers,
        ..
    }) = options.index
    else {
        return Ok(());
    };
    plans.iter().try_for_each(|plan| {
        let (tiles, dim) = (plan.grid_tiles() as usize, spec.global_len());
        IvfPqCodec::check(tiles, dim, nlist as usize, subquantisers as usize)
    })
}

/// Compares tiles, size and resampling work of a plan with the limits.
///
/// # Errors
/// Returns [`PackError::TooCostly`] or [`PackError::Options`] with the number that exceeds its limit.
pub fn check_cost(
    plans: &[LevelPlan],
    spec: &NetSpec,
    options: &BuildOptions,
    recipe: &dyn Recipe,
    limits: &BuildLimits,
) -> Result<()> {
    for plan in plans {
        let [width, height] = plan.size_px();
        let longer = width.max(height);
        if longer < limits.min_level_px {
            // The last pixel of a side may lie on the map with a part of it only.
            let covered_px = longer.saturating_sub(1).max(1);
            let finest_m = plan.frame.gsd_m * covered_px as f64 / limits.min_level_px as f64;
            return Err(PackError::Options(format!(
                "at {} m per pixel the map is {width} x {height} px, less than {} px along its longer side; choose a \
                 ground resolution below {finest_m:.3} m, or check the map's coordinate system and scale",
                plan.frame.gsd_m, limits.min_level_px
            )));
        }
    }
    let tiles = plans
        .iter()
        .fold(0u64, |sum, plan| sum.saturating_add(plan.grid_tiles()));
    if tiles > limits.max_tiles {
        return Err(PackError::TooCostly {
            what: format!("{tiles} tiles, more than the limit of {}", limits.max_tiles),
        });
    }
    let row_bytes = bytes_per_tile_descriptor(spec, recipe) + TABLE_BYTES_BESIDE;
    let table_bytes = tiles.saturating_mul(row_bytes);
    let most_bytes = PackLimits::default().max_table_bytes;
    if table_bytes > most_bytes {
        return Err(PackError::TooCostly {
            what: format!(
                "about {table_bytes} bytes of tables for {tiles} tiles, which a search copies into memory, more than the limit of \
                 {most_bytes}"
            ),
        });
    }
    let bytes = plans.iter().fold(0u64, |sum, plan| {
        let bytes = bytes_per_tile(plan, spec, options, recipe);
        sum.saturating_add(plan.grid_tiles().saturating_mul(bytes))
    });
    if bytes > limits.max_pack_bytes {
        return Err(PackError::TooCostly {
            what: format!(
                "about {bytes} bytes for {tiles} tiles, more than the limit of {}",
                limits.max_pack_bytes
            ),
        });
    }
    Ok(())
}

/// Largest size of a tile of a level in the pack, bytes.
pub fn bytes_per_tile(
    plan: &LevelPlan,
    spec: &NetSpec,
    options: &BuildOptions,
    recipe: &dyn Recipe,
) -> u64 {
    let number_len = recipe.descriptor_type().number_len() as u64;
    let indexed = if has_keypoint_index(plan, plan.grid_tiles(), options, recipe) {
        bytes_per_indexed_keypoint(spec.descriptor_dim) as u64
    } else {
        0
    };
    let bytes_per_keypoint = spec.descriptor_dim as u64 * number_len + 6 + indexed;
    u64::from(recipe.max_keypoints(spec, options)) * bytes_per_keypoint
        + bytes_per_tile_descriptor(spec, recipe)
}

fn bytes_per_tile_descriptor(spec: &NetSpec, recipe: &dyn Recipe) -> u64 {
    (spec.global_len() * recipe.descriptor_type().number_len()) as u64
}
