//! Checks what a manifest says against the limits of the format.
//!
//! Whoever writes a pack can also write its checksums, so that every number is checked before it is used.

use std::path::Path;

use crate::error::{PackError, Result};
use crate::manifest::{LevelManifest, Manifest};

/// Maximum number of levels: factors of two from a millimetre to beyond the Earth's size.
pub(crate) const MAX_LEVELS: usize = 64;

/// Maximum dimension of a local and of a tile descriptor.
pub(crate) const MAX_DESCRIPTOR_DIM: usize = 4096;
pub(crate) const MAX_GLOBAL_DIM: usize = 1 << 17;

/// Maximum side of a tile, level pixels, and of the image that the network sees: positions have 16 bits with steps of
/// 1/32 pixel.
const MAX_TILE_PX: u32 = 2048;

/// Maximum side of a level, pixels (65,536 cells), and distance of its first tile from the map's corner.
pub(crate) const MAX_LEVEL_PX: u64 = 1 << 24;

/// Maximum columns and rows of a grid.
const MAX_GRID: u32 = 1 << 17;

/// Maximum number of keypoints of a feature unit.
pub(crate) const MAX_KEYPOINTS_PER_UNIT: u32 = 1 << 16;

/// Checks the sizes in a manifest. References into sections are checked by [`crate::Level`].
///
/// # Errors
/// Returns [`PackError::Corrupt`] with the number that is out of range.
pub(crate) fn check_manifest(path: &Path, manifest: &Manifest) -> Result<()> {
    let model = &manifest.model;
    let dims = [
        ("descriptor_dim", model.descriptor_dim, MAX_DESCRIPTOR_DIM),
        ("global_dim", model.global_dim, MAX_GLOBAL_DIM),
    ];
    for (name, dim, max) in dims {
        if !(1..=max).contains(&dim) {
            return Err(PackError::corrupt(
                path,
                format!("{name} is {dim}; expected 1 to {max}"),
            ));
        }
    }
    if !(1..=MAX_LEVELS).contains(&manifest.levels.len()) {
        return Err(PackError::corrupt(
            path,
            format!(
                "{} levels; expected 1 to {MAX_LEVELS}",
                manifest.levels.len()
            ),
        ));
    }
    let side = manifest.map.size_px.iter().max().copied().unwrap_or(0);
    if !(1..=1 << 40).contains(&side) || manifest.map.size_px.contains(&0) {
        return Err(PackError::corrupt(
            path,
            "the size of the map is out of range",
        ));
    }
    for (i, level) in manifest.levels.iter().enumerate() {
        check_level(level)
            .map_err(|what| PackError::corrupt(path, format!("level {i}: {what}")))?;
    }
    Ok(())
}

fn check_level(m: &LevelManifest) -> std::result::Result<(), String> {
    let frame = &m.frame;
    let scales = [
        ("gsd_m", frame.gsd_m),
        ("map_px_per_level_px_x", frame.map_px_per_level_px_x),
        ("map_px_per_level_px_y", frame.map_px_per_level_px_y),
        ("descriptor_scale", f64::from(m.descriptor_scale)),
    ];
    for (name, value) in scales {
        if !(value.is_finite() && value > 0.0) {
            return Err(format!("{name} is {value}; expected a positive number"));
        }
    }
    let in_range = |name: &str, value: u64, max: u64| {
        if (1..=max).contains(&value) {
            Ok(())
        } else {
            Err(format!("{name} is {value}; expected 1 to {max}"))
        }
    };
    in_range("width_px", frame.width_px, MAX_LEVEL_PX)?;
    in_range("height_px", frame.height_px, MAX_LEVEL_PX)?;
    in_range("tile_px", m.tile_px.into(), MAX_TILE_PX.into())?;
    in_range("stride_px", m.stride_px.into(), m.tile_px.into())?;
    in_range("network_px", m.network_px.into(), MAX_TILE_PX.into())?;
    in_range("units_per_tile_side", m.units_per_tile_side.into(), 16)?;
    in_range(
        "keypoints_per_unit",
        m.keypoints_per_unit.into(),
        MAX_KEYPOINTS_PER_UNIT.into(),
    )?;
    if m.units_per_tile_side > 1
        && m.units_per_tile_side.checked_mul(m.stride_px) != Some(m.tile_px)
    {
        return Err(format!(
            "{} units of {} px do not make a tile of {} px",
            m.units_per_tile_side, m.stride_px, m.tile_px
        ));
    }
    for a in 0..2 {
        in_range("tile_grid", m.tile_grid[a].into(), MAX_GRID.into())?;
        if m.unit_grid[a] != m.tile_grid[a] + (m.units_per_tile_side - 1) {
            return Err(format!(
                "unit_grid {:?} does not fit tile_grid {:?}",
                m.unit_grid, m.tile_grid
            ));
        }
        if m.origin_px[a].unsigned_abs() > MAX_LEVEL_PX {
            return Err(format!("origin_px {:?} is out of range", m.origin_px));
        }
    }
    Ok(())
}
