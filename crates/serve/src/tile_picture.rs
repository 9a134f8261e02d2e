//! Pictures of tiles: the map, or the outlines of the pack.

use grimnet_geo::{GeoError, Raster, RasterPatch, WindowPx};
use grimnet_pack::{Level, Pack};
use image::{Rgba, RgbaImage};

use crate::tile_address::{TILE_SIDE_PX, TileAddress};
use crate::tile_mesh::TileMesh;

/// How much finer than the tile the map is read, before it is interpolated.
const FINER: f64 = 1.4;

/// Margin of the window that is read, map pixels at least.
const MARGIN_PX: f64 = 2.0;

/// Smallest side on the screen of a pack's tile whose outline is drawn, pixels.
const MIN_OUTLINE_PX: f64 = 16.0;

/// Half the width of outlines, pixels.
const HALF_LINE_PX: f64 = 0.75;

/// Colours of tiles of the pack and of their outlines.
const FILL: Rgba<u8> = Rgba([30, 120, 220, 36]);
const LINE: Rgba<u8> = Rgba([30, 120, 220, 190]);

/// The map in a tile; transparent where it has no data.
///
/// # Errors
/// Returns an error if the map cannot be read or its projection does not cover the tile.
pub(crate) fn map_picture(tile: TileAddress, map: &dyn Raster) -> Result<RgbaImage, GeoError> {
    let mesh = TileMesh::new(tile, map.georeference())?;
    let mut picture = RgbaImage::new(TILE_SIDE_PX, TILE_SIDE_PX);
    let (width, height) = map.size_px();
    let size = [width as f64, height as f64];
    let per_px = (mesh.map_px_per_px() / FINER).max(1.0);
    let [low, high] = mesh.bounds();
    let margin = MARGIN_PX * per_px;
    let from = [0, 1].map(|axis| (low[axis] - margin).floor().clamp(0.0, size[axis]));
    let to = [0, 1].map(|axis| (high[axis] + margin).ceil().clamp(0.0, size[axis]));
    let [w, h] = [to[0] - from[0], to[1] - from[1]];
    // Not finite, or beside the map.
    if !(w >= 1.0 && h >= 1.0) {
        return Ok(picture);
    }
    let pixels = |length: f64| (length / per_px).ceil().max(1.0) as u32;
    let window = WindowPx::new(from[0], from[1], w, h);
    let patch = map.read(window, pixels(w), pixels(h))?;
    for (i, j, pixel) in picture.enumerate_pixels_mut() {
        let at = mesh.at(f64::from(i) + 0.5, f64::from(j) + 0.5);
        let in_patch = [
            (at.x - window.x) / window.w * f64::from(patch.rgb.width()),
            (at.y - window.y) / window.h * f64::from(patch.rgb.height()),
        ];
        *pixel = interpolated(&patch, in_patch);
    }
    Ok(picture)
}

/// The colour at a continuous point of a patch: bilinear among the pixels that have data, transparent if they weigh less than half.
fn interpolated(patch: &RasterPatch, [x, y]: [f64; 2]) -> Rgba<u8> {
    let (width, height) = patch.rgb.dimensions();
    let inside = x >= 0.0 && y >= 0.0 && x <= f64::from(width) && y <= f64::from(height);
    if !inside {
        return Rgba([0; 4]);
    }
    let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
    let (mut sum, mut weight) = ([0.0; 3], 0.0);
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let share = (1.0 - (x - 0.5 - left - dx).abs()) * (1.0 - (y - 0.5 - top - dy).abs());
        // The edge pixels continue to the edge.
        let column = (left + dx).clamp(0.0, f64::from(width) - 1.0) as u32;
        let row = (top + dy).clamp(0.0, f64::from(height) - 1.0) as u32;
        if patch.valid.get_pixel(column, row).0[0] > 0 {
            for (sum, &sample) in sum.iter_mut().zip(&patch.rgb.get_pixel(column, row).0) {
                *sum += share * f64::from(sample);
            }
            weight += share;
        }
    }
    if weight < 0.5 {
        return Rgba([0; 4]);
    }
    let [r, g, b] = sum.map(|sum| (sum / weight).round() as u8);
    Rgba([r, g, b, 255])
}

/// The tiles of the pack in a tile of the screen: those of the finest level that is not too fine to be seen. The middle quarter of
/// each is outlined: whole tiles overlap by half, their middles do not.
///
/// # Errors
/// Returns an error if the map's projection does not cover the tile.
pub(crate) fn outline_picture(tile: TileAddress, pack: &Pack) -> Result<RgbaImage, GeoError> {
    let mesh = TileMesh::new(tile, pack.georeference())?;
    let mut picture = RgbaImage::new(TILE_SIDE_PX, TILE_SIDE_PX);
    let map_px_per_px = mesh.map_px_per_px();
    let map_px = pack.manifest().map.ground_resolution_m[0];
    let stride_px = |level: &Level| {
        f64::from(level.manifest().stride_px) * level.gsd_m() / map_px / map_px_per_px
    };
    let levels = pack.levels();
    let Some(level) = levels
        .iter()
        .find(|level| stride_px(level) >= MIN_OUTLINE_PX)
        .or(levels.last())
    else {
        return Ok(picture);
    };
    let lines = stride_px(level) >= MIN_OUTLINE_PX;
    let half_line = HALF_LINE_PX / stride_px(level);
    let manifest = level.manifest();
    let stride = f64::from(manifest.stride_px);
    let quarter = f64::from(manifest.tile_px) / 4.0;
    for (i, j, pixel) in picture.enumerate_pixels_mut() {
        let at = level.level_px_from_map_px(mesh.at(f64::from(i) + 0.5, f64::from(j) + 0.5));
        let along = [
            (at.x - manifest.origin_px[0] as f64 - quarter) / stride,
            (at.y - manifest.origin_px[1] as f64 - quarter) / stride,
        ];
        let grid = along.map(f64::floor);
        let inside = grid.iter().all(|&at| at >= 0.0 && at < f64::from(u32::MAX));
        if !inside || level.tile_at(grid.map(|at| at as u32)).is_none() {
            continue;
        }
        let edge = along
            .iter()
            .zip(grid)
            .any(|(&at, cell)| at - cell < half_line || cell + 1.0 - at < half_line);
        *pixel = if lines && edge { LINE } else { FILL };
    }
    Ok(picture)
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma, Rgb, RgbImage};

    use super::*;

    #[test]
    fn pixels_without_data_do_not_darken_their_neighbours() {
        let mut patch = RasterPatch {
            rgb: RgbImage::from_pixel(2, 1, Rgb([200, 100, 50])),
            valid: GrayImage::from_pixel(2, 1, Luma([255])),
        };
        patch.rgb.put_pixel(1, 0, Rgb([0, 0, 0]));
        patch.valid.put_pixel(1, 0, Luma([0]));
        assert_eq!(interpolated(&patch, [0.9, 0.5]), Rgba([200, 100, 50, 255]));
        assert_eq!(interpolated(&patch, [1.4, 0.5]), Rgba([0; 4]));
        for outside in [[-0.1, 0.5], [2.1, 0.5], [0.5, f64::NAN]] {
            assert_eq!(interpolated(&patch, outside), Rgba([0; 4]));
        }
    }
}
