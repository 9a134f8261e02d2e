//! Which levels a pack gets, and how each is cut into cells, tiles and pieces of work.

use grimnet_geo::{Georeference, LevelFrame, TileGrid};
use grimnet_net::NetSpec;

use crate::error::{PackError, Result};
use crate::level::{CELL_PX, TILE_PX};
use crate::options::{BuildOptions, Levels, Mode};

/// Finest resolution that [`Levels::Auto`] makes, metres a pixel: drones fly higher than finer pixels are of use.
pub const FINEST_AUTO_GSD_M: f64 = 0.15;

/// Cells along the side of a block (default mode): one network pass makes the features of so many squared. Larger blocks
/// waste less on their halo; networks that are wide at full resolution get smaller ones, to stay below a gigabyte.
fn block_cells(spec: &NetSpec) -> u32 {
    const WIDE: usize = 16;
    if spec.widest_per_pixel() <= WIDE {
        4
    } else {
        2
    }
}

/// Pixels around a block that the network sees as well, so that features at its border know their surroundings.
pub const HALO_PX: u32 = 64;

/// Tiles in one piece of work in paper mode.
pub const PAPER_TILES_PER_ITEM: u32 = 8;

/// Largest side of the picture that paper mode resizes a tile to: positions are stored in 16 bits.
pub const LARGEST_RESOLUTION_PX: u32 = 2016;

/// Largest side of a level, pixels: 65,536 cells.
const LARGEST_LEVEL_PX: u64 = 1 << 24;

/// A level before it is computed; the fields mean what they mean in [`crate::manifest::LevelManifest`].
#[derive(Clone, Debug, PartialEq)]
pub struct LevelPlan {
    pub frame: LevelFrame,
    pub origin_px: [i64; 2],
    pub network_px: u32,
    pub tile_grid: [u32; 2],
    pub unit_grid: [u32; 2],
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
    fn new(frame: LevelFrame, options: &BuildOptions) -> Result<Self> {
        let size_px = [frame.width_px, frame.height_px];
        let describe = || format!("{} x {} px at {} m/px", size_px[0], size_px[1], frame.gsd_m);
        if size_px.iter().any(|&s| s > LARGEST_LEVEL_PX) {
            return Err(PackError::Options(format!(
                "the map would be {}, too many; choose a coarser --gsd",
                describe()
            )));
        }
        let (origin_px, tile_grid, unit_grid, network_px) = match options.mode {
            Mode::Default => {
                // Whole cells, the rest shared between both sides: nothing of the map is lost, and a tile at
                // the border is never less than three quarters map.
                let cells = size_px.map(|s| (s.div_ceil(u64::from(CELL_PX)) as u32).max(2));
                let padding =
                    |a: usize| (u64::from(cells[a]) * u64::from(CELL_PX) - size_px[a]) as i64;
                (
                    [-padding(0) / 2, -padding(1) / 2],
                    cells.map(|c| c - 1),
                    cells,
                    TILE_PX,
                )
            }
            Mode::Paper => {
                let grid = TileGrid::paper(size_px[0], size_px[1])?;
                if grid.is_empty() {
                    return Err(PackError::Options(format!(
                        "the map is {}, smaller than a tile of {TILE_PX} px; paper mode needs a finer --gsd, \
                         default mode pads small maps",
                        describe()
                    )));
                }
                let tiles = [grid.columns() as u32, grid.rows() as u32];
                ([0, 0], tiles, tiles, options.resolution)
            }
        };
        Ok(Self {
            frame,
            origin_px,
            network_px,
            tile_grid,
            unit_grid,
        })
    }

    /// The level's size, pixels.
    pub fn size_px(&self) -> [u64; 2] {
        [self.frame.width_px, self.frame.height_px]
    }

    /// Columns and rows of units in one piece of work.
    fn item_units(mode: Mode, spec: &NetSpec) -> [u32; 2] {
        match mode {
            Mode::Default => [block_cells(spec); 2],
            Mode::Paper => [PAPER_TILES_PER_ITEM, 1],
        }
    }

    /// The level's pieces of work, row by row.
    pub fn items(
        &self,
        level: u32,
        mode: Mode,
        spec: &NetSpec,
    ) -> impl Iterator<Item = Item> + use<> {
        let step = Self::item_units(mode, spec);
        let grid = self.unit_grid;
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

    /// Level pixels of a unit's top-left corner.
    pub fn unit_origin_px(&self, unit: [u32; 2]) -> [i64; 2] {
        std::array::from_fn(|a| self.origin_px[a] + i64::from(unit[a]) * i64::from(CELL_PX))
    }

    /// How many of the pixels of a square are inside the map.
    pub fn inside_px(&self, origin_px: [i64; 2], side_px: u32) -> u64 {
        let overlap = |a: usize| {
            let end = (origin_px[a] + i64::from(side_px)).min(self.size_px()[a] as i64);
            (end - origin_px[a].max(0)).max(0) as u64
        };
        overlap(0) * overlap(1)
    }

    /// Tiles of the grid.
    pub fn tile_places(&self) -> u64 {
        u64::from(self.tile_grid[0]) * u64::from(self.tile_grid[1])
    }
}

/// Plans the levels for a map of `map_px` pixels, finest first.
///
/// # Errors
/// [`PackError::Options`] where options and map do not go together, [`PackError::Map`] where the map has no place on
/// Earth.
pub fn plan_levels(
    georeference: &Georeference,
    map_px: (u64, u64),
    options: &BuildOptions,
) -> Result<Vec<LevelPlan>> {
    check(options)?;
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let own_gsd_m = (x_m * y_m).sqrt();
    let usable = map_px.0 > 0 && map_px.1 > 0 && own_gsd_m.is_finite() && own_gsd_m > 0.0;
    if !usable {
        return Err(PackError::Options(format!(
            "the map has {} x {} px of {x_m} x {y_m} m; check its georeference",
            map_px.0, map_px.1
        )));
    }
    let gsds_m = match &options.levels {
        Levels::Gsd(list) => {
            let mut list = list.clone();
            list.sort_by(f64::total_cmp);
            list.dedup();
            list
        }
        Levels::Auto if options.mode == Mode::Paper => vec![own_gsd_m],
        Levels::Auto => {
            let map_m = [map_px.0 as f64 * x_m, map_px.1 as f64 * y_m];
            auto_gsds_m(own_gsd_m, map_m, options.max_tile_m)
        }
    };
    let plan = |gsd_m| LevelPlan::new(LevelFrame::new(georeference, map_px, gsd_m)?, options);
    gsds_m.into_iter().map(plan).collect()
}

/// Resolutions a factor of two apart, until a tile is about `max_tile_m` wide or covers the map.
fn auto_gsds_m(own_gsd_m: f64, map_m: [f64; 2], max_tile_m: f64) -> Vec<f64> {
    let mut gsds_m = vec![own_gsd_m.max(FINEST_AUTO_GSD_M)];
    loop {
        let last = gsds_m[gsds_m.len() - 1];
        let tile_m = last * f64::from(TILE_PX);
        // The next tile would be further from `max_tile_m`, by ratio, than this one.
        let about_max = 2.0 * tile_m > max_tile_m * std::f64::consts::SQRT_2;
        if about_max || map_m.iter().all(|&m| tile_m >= m) {
            return gsds_m;
        }
        gsds_m.push(2.0 * last);
    }
}

fn check(options: &BuildOptions) -> Result<()> {
    let refuse = |why: String| Err(PackError::Options(why));
    if let Levels::Gsd(list) = &options.levels
        && (list.is_empty() || list.iter().any(|g| !(g.is_finite() && *g > 0.0)))
    {
        return refuse(format!(
            "ground resolutions must be positive metres a pixel, not {list:?}"
        ));
    }
    let side = options.resolution;
    if side == 0 || !side.is_multiple_of(32) || side > LARGEST_RESOLUTION_PX {
        return refuse(format!(
            "the resolution must be a multiple of 32 up to {LARGEST_RESOLUTION_PX}, not {side}"
        ));
    }
    if !(options.max_tile_m.is_finite() && options.max_tile_m > 0.0) {
        return refuse(format!(
            "the largest tile must be some metres wide, not {}",
            options.max_tile_m
        ));
    }
    if !(0.0..1.0).contains(&options.keypoint_threshold) || options.max_keypoints == 0 {
        return refuse(
            "the keypoint threshold must lie in 0..1 and at least one keypoint be kept".into(),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A north-up map at 45 degrees north in UTM with pixels of these metres.
    fn utm(map_px: (u64, u64), x_m: f64, y_m: f64) -> Georeference {
        let affine =
            grimnet_geo::Affine::from_gdal([500_000.0, x_m, 0.0, 4_982_950.0, 0.0, -y_m]).unwrap();
        let crs = grimnet_geo::Crs::parse("EPSG:32632").unwrap();
        Georeference::new(affine, crs, map_px)
    }

    fn plan(map_px: (u64, u64), gsd_m: f64, options: &BuildOptions) -> LevelPlan {
        // The scale of UTM is 0.9996 at its central meridian.
        let options = BuildOptions {
            levels: Levels::Gsd(vec![gsd_m / 0.9996]),
            ..options.clone()
        };
        plan_levels(&utm(map_px, gsd_m, gsd_m), map_px, &options)
            .unwrap()
            .remove(0)
    }

    #[test]
    fn auto_levels_go_up_to_a_kilometre_or_the_map() {
        assert_eq!(
            auto_gsds_m(0.25, [9000.0, 9000.0], 1000.0),
            [0.25, 0.5, 1.0, 2.0]
        );
        assert_eq!(
            auto_gsds_m(0.05, [9000.0, 9000.0], 1000.0)[0],
            FINEST_AUTO_GSD_M
        );
        assert_eq!(
            auto_gsds_m(0.16, [656.0, 623.0], 1000.0),
            [0.16, 0.32, 0.64, 1.28, 2.56]
        );
        assert_eq!(auto_gsds_m(0.2, [50.0, 90.0], 1000.0), [0.2]);
        assert_eq!(auto_gsds_m(10.0, [1e6, 1e6], 1000.0), [10.0]);
    }

    #[test]
    fn paper_tiles_as_counted_by_hand() {
        let level = plan((1500, 1023), 0.3, &BuildOptions::paper());
        // 0, 256, 512, 768 (+512 = 1280 <= 1500); 1024 + 512 would not fit. 0, 256 (+512 = 768), 511 is short of 512.
        assert_eq!(level.tile_grid, [4, 2]);
        assert_eq!((level.origin_px, level.network_px), ([0, 0], 320));
        let error = plan_levels(
            &utm((400, 600), 0.3, 0.3),
            (400, 600),
            &BuildOptions::paper(),
        )
        .unwrap_err();
        assert!(error.to_string().contains("smaller than a tile"), "{error}");
    }

    #[test]
    fn small_maps_are_padded_on_both_sides() {
        let level = plan((100, 600), 0.3, &BuildOptions::standard());
        assert_eq!((level.tile_grid, level.unit_grid), ([1, 2], [2, 3]));
        assert_eq!(level.origin_px, [-206, -84]);
    }

    #[test]
    fn unequal_pixels_come_out_square() {
        let options = BuildOptions {
            levels: Levels::Gsd(vec![0.5]),
            ..BuildOptions::standard()
        };
        let level = plan_levels(&utm((1000, 1000), 0.25, 0.5), (1000, 1000), &options)
            .unwrap()
            .remove(0);
        assert!((level.frame.map_px_per_level_px_x - 2.0).abs() < 0.002);
        assert!((level.frame.map_px_per_level_px_y - 1.0).abs() < 0.001);
        assert_eq!(
            level.size_px(),
            [501, 1001],
            "the ground is 1/0.9996 times as long"
        );
    }

    #[test]
    fn nonsense_is_refused() {
        let refused = |options: BuildOptions| {
            plan_levels(&utm((999, 999), 0.3, 0.3), (999, 999), &options).is_err()
        };
        let standard = BuildOptions::standard;
        assert!(refused(BuildOptions {
            levels: Levels::Gsd(vec![]),
            ..standard()
        }));
        assert!(refused(BuildOptions {
            levels: Levels::Gsd(vec![f64::NAN]),
            ..standard()
        }));
        assert!(refused(BuildOptions {
            levels: Levels::Gsd(vec![1e-9]),
            ..standard()
        }));
        assert!(refused(BuildOptions {
            resolution: 300,
            ..standard()
        }));
        assert!(refused(BuildOptions {
            max_tile_m: 0.0,
            ..standard()
        }));
        assert!(refused(BuildOptions {
            max_keypoints: 0,
            ..standard()
        }));
        assert!(plan_levels(&utm((9, 9), 0.3, 0.3), (0, 9), &standard()).is_err());
    }

    proptest! {
        #[test]
        fn every_map_pixel_is_in_a_tile_and_every_unit_in_one_item(
            width in 1u64..5000, height in 1u64..5000,
        ) {
            let level = plan((width, height), 0.3, &BuildOptions::standard());
            for a in 0..2 {
                let end = level.origin_px[a] + i64::from(level.tile_grid[a] + 1) * 256;
                prop_assert!(level.origin_px[a] <= 0 && end >= level.size_px()[a] as i64);
                // No row or column of cells lies outside the map altogether but for maps below a cell.
                if level.size_px()[a] > 256 {
                    prop_assert!(level.origin_px[a] > -128 && end - (level.size_px()[a] as i64) <= 128);
                }
            }
            let mut seen = vec![0u8; (level.unit_grid[0] * level.unit_grid[1]) as usize];
            for item in level.items(0, Mode::Default, &NetSpec::compact()) {
                for y in 0..item.count[1] {
                    for x in 0..item.count[0] {
                        let at = (item.first[1] + y) * level.unit_grid[0] + item.first[0] + x;
                        seen[at as usize] += 1;
                    }
                }
            }
            prop_assert!(seen.iter().all(|&n| n == 1));
        }
    }
}
