//! A level before it is computed, and the pieces of work it is computed in.

use grimnet_geo::{LevelFrame, LevelPx, WindowPx};

use crate::level::CELL_PX;

/// How a level is divided into tiles and feature units (cells or paper tiles). The fields have the meaning of those of
/// [`crate::manifest::LevelManifest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub origin_px: [i64; 2],
    pub network_px: u32,
    pub tile_grid: [u32; 2],
    pub unit_grid: [u32; 2],
}

/// A level before it is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelPlan {
    pub frame: LevelFrame,
    pub layout: Layout,
    /// Columns and rows of units in one piece of work.
    pub units_per_item: [u32; 2],
}

/// A piece of work: the units in a rectangle of the unit grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Item {
    /// Index of the level.
    pub level: u32,
    /// First column and row.
    pub first: [u32; 2],
    /// Columns and rows.
    pub count: [u32; 2],
}

impl LevelPlan {
    /// The level's size, pixels.
    pub fn size_px(&self) -> [u64; 2] {
        [self.frame.width_px, self.frame.height_px]
    }

    /// The level's pieces of work, row by row.
    pub fn items(&self, level: u32) -> impl Iterator<Item = Item> + use<> {
        let (step, grid) = (self.units_per_item, self.layout.unit_grid);
        let rows = (0..grid[1]).step_by(step[1] as usize);
        rows.flat_map(move |row| {
            (0..grid[0])
                .step_by(step[0] as usize)
                .map(move |column| Item {
                    level,
                    first: [column, row],
                    count: [step[0].min(grid[0] - column), step[1].min(grid[1] - row)],
                })
        })
    }

    /// Top-left corner of a unit, level pixels.
    pub fn unit_origin_px(&self, unit: [u32; 2]) -> [i64; 2] {
        std::array::from_fn(|a| self.layout.origin_px[a] + i64::from(unit[a]) * i64::from(CELL_PX))
    }

    /// Number of pixels of a square of the level that lie inside the map.
    pub fn inside_px(&self, origin_px: [i64; 2], side_px: u32) -> u64 {
        let overlap = |a: usize| {
            let end = (origin_px[a] + i64::from(side_px)).min(self.size_px()[a] as i64);
            (end - origin_px[a].max(0)).max(0) as u64
        };
        overlap(0) * overlap(1)
    }

    /// Number of tiles of the grid.
    pub fn grid_tiles(&self) -> u64 {
        u64::from(self.layout.tile_grid[0]) * u64::from(self.layout.tile_grid[1])
    }

    /// The window of the map that a rectangle of the level covers.
    pub fn map_window(&self, window: &LevelWindow) -> WindowPx {
        let [x, y] = window.origin_px.map(|v| v as f64);
        let [width, height] = window.size_px.map(f64::from);
        self.frame.map_window(LevelPx::new(x, y), width, height)
    }
}

/// A rectangle of whole level pixels; it may reach beyond the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelWindow {
    /// Top-left corner, level pixels.
    pub origin_px: [i64; 2],
    /// Width and height, level pixels.
    pub size_px: [u32; 2],
}
