//! A small picture of the map with the tiles of a level.

use grimnet_geo::{LevelPx, Raster, WindowPx};
use image::{Rgb, RgbImage};

use crate::error::{PackError, Result};
use crate::pack::Pack;

/// Longer side of the picture, pixels.
const LONGER_SIDE_PX: f64 = 1600.0;

/// Colour of the border of tiles that have a descriptor, and of the cross over those that were skipped.
const TILE_COLOUR: Rgb<u8> = Rgb([255, 200, 40]);
const SKIPPED_COLOUR: Rgb<u8> = Rgb([230, 40, 60]);

/// The map at a reduced size with the tiles of level `level`: the middle quarter of each tile is outlined (whole tiles
/// overlap by half, their middles do not), skipped ones are crossed out.
///
/// # Errors
/// Returns [`PackError::Options`] if there is no such level or the map has another size than the pack's, and
/// [`PackError::Map`] if the map cannot be read.
pub fn draw(pack: &Pack, level: usize, raster: &dyn Raster) -> Result<RgbImage> {
    let count = pack.levels().len();
    let Some(level) = pack.levels().get(level) else {
        return Err(PackError::Options(format!(
            "the pack has {count} levels, there is no level {level}"
        )));
    };
    let (map_w, map_h) = raster.size_px();
    if [map_w, map_h] != pack.manifest().map.size_px {
        let [w, h] = pack.manifest().map.size_px;
        return Err(PackError::Options(format!(
            "the pack was built from a map of {w} x {h} px, this one has {map_w} x {map_h}"
        )));
    }
    let m = level.manifest();
    let end = |a: usize| {
        m.origin_px[a]
            + i64::from(m.tile_grid[a] - 1) * i64::from(m.stride_px)
            + i64::from(m.tile_px)
    };
    let size = level.size_px().map(|v| v as i64);
    // Padding around small maps is drawn as well.
    let from = [0, 1].map(|a| m.origin_px[a].min(0));
    let to = [0, 1].map(|a| end(a).max(size[a]));
    let span = [0, 1].map(|a| (to[a] - from[a]) as f64);
    let per_px = (span[0].max(span[1]) / LONGER_SIDE_PX).max(1.0);
    let out = span.map(|s| ((s / per_px).round() as u32).max(1));
    let top_left = LevelPx::new(from[0] as f64, from[1] as f64);
    let window: WindowPx = level.frame().map_window(top_left, span[0], span[1]);
    let mut picture = raster.read(window, out[0], out[1])?.rgb;
    let at = |place: i64, a: usize| {
        (((place - from[a]) as f64) / span[a] * f64::from(out[a])).round() as i64
    };
    let (quarter, half) = (i64::from(m.tile_px / 4), i64::from(m.tile_px / 2));
    for row in 0..m.tile_grid[1] {
        for column in 0..m.tile_grid[0] {
            let corner = |a: usize, step: u32| {
                m.origin_px[a] + i64::from(step) * i64::from(m.stride_px) + quarter
            };
            let (left, top) = (corner(0, column), corner(1, row));
            let (x0, x1) = (at(left, 0), at(left + half, 0) - 1);
            let (y0, y1) = (at(top, 1), at(top + half, 1) - 1);
            if level.tile_at([column, row]).is_some() {
                for (from, to) in [
                    ([x0, y0], [x1, y0]),
                    ([x0, y1], [x1, y1]),
                    ([x0, y0], [x0, y1]),
                    ([x1, y0], [x1, y1]),
                ] {
                    line(&mut picture, from, to, TILE_COLOUR);
                }
            } else {
                line(&mut picture, [x0, y0], [x1, y1], SKIPPED_COLOUR);
                line(&mut picture, [x0, y1], [x1, y0], SKIPPED_COLOUR);
            }
        }
    }
    Ok(picture)
}

/// A line one pixel wide, clipped to the picture.
fn line(picture: &mut RgbImage, from: [i64; 2], to: [i64; 2], colour: Rgb<u8>) {
    let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).max(1);
    for i in 0..=steps {
        let [x, y] = [0, 1].map(|a| from[a] + (to[a] - from[a]) * i / steps);
        if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
            && x < picture.width()
            && y < picture.height()
        {
            picture.put_pixel(x, y, colour);
        }
    }
}
