//! Tile descriptors from cells, while blocks are computed row by row.
//!
//! NetVLAD is a sum over positions (paper, eq. 6), so the sum of a tile is that of its four cells before normalisation.
//! Only cells at the lower and right border of the finished part can belong to a further tile: memory is one row of
//! cells.

use std::collections::HashMap;

use crate::builder::level_plan::{Item, LevelPlan};
use crate::builder::usable::{MIN_USABLE_OF_TILE, is_enough};
use crate::format::TileEntry;

/// What the tiles of a cell need of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellSum {
    /// Unnormalised VLAD sum; `None` for a skipped cell.
    pub vlad: Option<Vec<f32>>,
    /// Usable pixels.
    pub usable_px: u32,
    /// Pixels inside the map.
    pub inside_px: u32,
}

/// The border between finished and remaining cells of one level.
#[derive(Clone, Debug, Default)]
pub struct Frontier {
    /// Cells that remaining tiles may need, by column and row.
    cells: HashMap<[u32; 2], CellSum>,
}

/// A tile whose four cells are computed.
#[derive(Clone, Debug, PartialEq)]
pub struct CompleteTile {
    /// Its place in the tile grid.
    pub place: TileEntry,
    /// Sum of its cells; `None` if it is to be skipped.
    pub vlad: Option<Vec<f32>>,
}

impl Frontier {
    /// Adds the cells of an item (row by row) and returns the tiles that they complete, row by row.
    pub fn complete(&mut self, item: &Item, cells: Vec<CellSum>) -> Vec<CompleteTile> {
        self.add(item, cells.into_iter().enumerate());
        let [first_x, first_y] = item.first;
        let [end_x, end_y] = [0, 1].map(|a| item.first[a] + item.count[a]);
        let mut tiles = Vec::new();
        // A tile belongs to the block of its lower right cell.
        for row in first_y.max(1)..end_y {
            for column in first_x.max(1)..end_x {
                let place = TileEntry {
                    column: column - 1,
                    row: row - 1,
                };
                tiles.push(CompleteTile {
                    place,
                    vlad: self.sum(place),
                });
            }
        }
        self.forget(item);
        tiles
    }

    /// Restores the kept cells of an item that an earlier run finished.
    pub fn restore(&mut self, item: &Item, kept: impl IntoIterator<Item = (usize, CellSum)>) {
        self.add(item, kept);
        self.forget(item);
    }

    /// Whether later items need a unit of an item: those of its last row and column, unless they are the level's.
    pub fn is_kept(plan: &LevelPlan, item: &Item, index: usize) -> bool {
        let [x, y] = [index as u32 % item.count[0], index as u32 / item.count[0]];
        let last = |a: usize, v: u32| {
            v + 1 == item.count[a] && item.first[a] + item.count[a] < plan.layout.unit_grid[a]
        };
        last(0, x) || last(1, y)
    }

    fn add(&mut self, item: &Item, cells: impl IntoIterator<Item = (usize, CellSum)>) {
        for (i, cell) in cells {
            let at = [i as u32 % item.count[0], i as u32 / item.count[0]];
            self.cells
                .insert([item.first[0] + at[0], item.first[1] + at[1]], cell);
        }
    }

    fn sum(&self, tile: TileEntry) -> Option<Vec<f32>> {
        let cells = [[0, 0], [1, 0], [0, 1], [1, 1]]
            .map(|[dx, dy]| self.cells.get(&[tile.column + dx, tile.row + dy]));
        let count =
            |of: fn(&CellSum) -> u32| cells.iter().flatten().map(|c| u64::from(of(c))).sum();
        if !is_enough(
            count(|c| c.usable_px),
            count(|c| c.inside_px),
            MIN_USABLE_OF_TILE,
        ) {
            return None;
        }
        let mut sums = cells.iter().flatten().filter_map(|c| c.vlad.as_ref());
        let mut total = sums.next()?.clone();
        for sum in sums {
            total.iter_mut().zip(sum).for_each(|(t, s)| *t += s);
        }
        Some(total)
    }

    /// Drops what no remaining tile needs: cells left of this item's last column in rows that end here, and cells of
    /// the row above.
    fn forget(&mut self, item: &Item) {
        let last = [0, 1].map(|a| item.first[a] + item.count[a] - 1);
        // The next item's first tile needs the last column, and the cell above it; the next row needs the last row.
        self.cells.retain(|&[x, y], _| x >= last[0] || y >= last[1]);
        if item.first[0] == 0 {
            // A new row of items: nothing left of the row before last is needed.
            self.cells.retain(|&[_, y], _| y + 1 >= item.first[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::cells::Cells;
    use crate::builder::planning::plan_levels;
    use crate::options::{BuildOptions, Levels};
    use grimnet_geo::{Affine, Crs, Georeference};
    use grimnet_net::NetSpec;
    use proptest::prelude::*;

    fn plan(width: u64, height: u64) -> LevelPlan {
        let affine = Affine::from_gdal([500_000.0, 1.0, 0.0, 4_982_950.0, 0.0, -1.0]).unwrap();
        let size = (width, height);
        let georeference = Georeference::new(affine, Crs::parse("EPSG:32632").unwrap(), size);
        let options = BuildOptions {
            levels: Levels::Gsd(vec![1.0]),
            ..BuildOptions::standard()
        };
        plan_levels(&georeference, size, &options, &Cells, &NetSpec::compact())
            .unwrap()
            .remove(0)
    }

    fn cells(item: &Item) -> Vec<CellSum> {
        (0..item.count[0] * item.count[1])
            .map(|i| {
                let [x, y] = [
                    item.first[0] + i % item.count[0],
                    item.first[1] + i / item.count[0],
                ];
                let vlad = (x * 7 + y * 3) % 5 != 0;
                CellSum {
                    vlad: vlad.then(|| vec![(x + 100 * y) as f32, 1.0]),
                    usable_px: u32::from(vlad) * 100,
                    inside_px: 100,
                }
            })
            .collect()
    }

    proptest! {
        #[test]
        fn every_tile_once_with_its_four_cells_wherever_resumed(
            width in 1u64..6000, height in 1u64..6000, stop in 0usize..40,
        ) {
            let plan = plan(width, height);
            let mut tiles = Vec::new();
            let mut frontier = Frontier::default();
            let mut journal = Vec::new();
            for (n, item) in plan.items(0).enumerate() {
                if n == stop {
                    frontier = Frontier::default();
                    for (item, kept) in journal.clone() {
                        frontier.restore(&item, kept);
                    }
                }
                let all = cells(&item);
                let kept: Vec<_> = all.iter().cloned().enumerate()
                    .filter(|(i, _)| Frontier::is_kept(&plan, &item, *i)).collect();
                journal.push((item, kept));
                tiles.extend(frontier.complete(&item, all));
                let row = plan.layout.unit_grid[0] as usize;
                prop_assert!(frontier.cells.len() <= row + 2 * 4 + 4, "{} cells kept", frontier.cells.len());
            }
            tiles.sort_by_key(|t| (t.place.row, t.place.column));
            prop_assert_eq!(tiles.len() as u64, plan.grid_tiles());
            for (i, tile) in tiles.iter().enumerate() {
                let place = TileEntry {
                    column: i as u32 % plan.layout.tile_grid[0],
                    row: i as u32 / plan.layout.tile_grid[0],
                };
                prop_assert_eq!(tile.place, place);
                let mut expected: Option<Vec<f32>> = None;
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, y) = (place.column + x, place.row + y);
                    if (x * 7 + y * 3) % 5 != 0 {
                        let sum = expected.get_or_insert(vec![0.0, 0.0]);
                        sum[0] += (x + 100 * y) as f32;
                        sum[1] += 1.0;
                    }
                }
                prop_assert_eq!(&tile.vlad, &expected);
            }
        }
    }
}
