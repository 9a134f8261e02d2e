//! Which levels a pack gets.

use grimnet_geo::{Georeference, LevelFrame};
use grimnet_net::NetSpec;

use crate::builder::level_plan::LevelPlan;
use crate::builder::recipe::Recipe;
use crate::error::{PackError, Result};
use crate::manifest_check::{
    MAX_DESCRIPTOR_DIM, MAX_GLOBAL_DIM, MAX_KEYPOINTS_PER_UNIT, MAX_LEVEL_PX, MAX_LEVELS,
};
use crate::options::{BuildOptions, Levels};

/// Largest side of the image that paper mode resizes a tile to: positions are stored in 16 bits.
const MAX_RESOLUTION_PX: u32 = 2016;

/// Plans the levels for a map of `map_px` pixels, finest first.
///
/// # Errors
/// Returns [`PackError::Options`] if options and map do not fit together, [`PackError::Map`] if the map has no
/// position on Earth.
pub fn plan_levels(
    georeference: &Georeference,
    map_px: (u64, u64),
    options: &BuildOptions,
    recipe: &dyn Recipe,
    spec: &NetSpec,
) -> Result<Vec<LevelPlan>> {
    check(options)?;
    check_stored_sizes(options, recipe, spec)?;
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let own_gsd_m = (x_m * y_m).sqrt();
    let usable = map_px.0 > 0 && map_px.1 > 0 && own_gsd_m.is_finite() && own_gsd_m > 0.0;
    if !usable {
        return Err(PackError::Options(format!(
            "the map has {} x {} px of {x_m} x {y_m} m; check its georeference",
            map_px.0, map_px.1
        )));
    }
    let frames = match &options.levels {
        Levels::Gsd(list) => {
            let mut list = list.clone();
            list.sort_by(f64::total_cmp);
            list.dedup();
            list.into_iter()
                .map(|gsd_m| Ok(LevelFrame::new(georeference, map_px, gsd_m)?))
                .collect::<Result<Vec<_>>>()?
        }
        Levels::Auto => recipe.auto_frames(georeference, map_px, options)?,
    };
    if frames.len() > recipe.most_levels() {
        return Err(PackError::Options(format!(
            "{} ground resolutions; a pack of paper mode has one, because the paper does not choose among several",
            frames.len()
        )));
    }
    if frames.len() > MAX_LEVELS {
        return Err(PackError::Options(format!(
            "{} ground resolutions; a pack has at most {MAX_LEVELS}",
            frames.len()
        )));
    }
    frames
        .into_iter()
        .map(|frame| plan_level(frame, recipe, spec))
        .collect()
}

fn plan_level(frame: LevelFrame, recipe: &dyn Recipe, spec: &NetSpec) -> Result<LevelPlan> {
    let size_px = [frame.width_px, frame.height_px];
    let describe = || format!("{} x {} px at {} m/px", size_px[0], size_px[1], frame.gsd_m);
    if size_px.iter().any(|&s| s > MAX_LEVEL_PX) {
        return Err(PackError::Options(format!(
            "the map would be {}, more than {MAX_LEVEL_PX} px along a side; choose a coarser ground resolution",
            describe()
        )));
    }
    let layout = recipe
        .layout(size_px)
        .map_err(|why| PackError::Options(format!("the map is {}, {why}", describe())))?;
    Ok(LevelPlan {
        frame,
        layout,
        units_per_item: recipe.units_per_item(spec),
    })
}

fn check(options: &BuildOptions) -> Result<()> {
    let refuse = |why: String| Err(PackError::Options(why));
    if let Levels::Gsd(list) = &options.levels
        && (list.is_empty() || list.iter().any(|g| !(g.is_finite() && *g > 0.0)))
    {
        return refuse(format!(
            "ground resolutions must be positive numbers of metres per pixel, not {list:?}"
        ));
    }
    let side = options.resolution;
    if side == 0 || !side.is_multiple_of(32) || side > MAX_RESOLUTION_PX {
        return refuse(format!(
            "the resolution of paper mode must be a multiple of 32 up to {MAX_RESOLUTION_PX}, not {side}"
        ));
    }
    if !(options.max_tile_m.is_finite() && options.max_tile_m > 0.0) {
        return refuse(format!(
            "the largest tile must be a positive number of metres wide, not {}",
            options.max_tile_m
        ));
    }
    if !(0.0..1.0).contains(&options.keypoint_threshold) {
        return refuse(format!(
            "the keypoint threshold must be at least 0 and below 1, not {}",
            options.keypoint_threshold
        ));
    }
    if options.max_keypoints == 0 {
        return refuse("the maximum number of keypoints must be at least 1, not 0".into());
    }
    Ok(())
}

/// Checks that a pack of these descriptors and keypoints can be opened.
fn check_stored_sizes(options: &BuildOptions, recipe: &dyn Recipe, spec: &NetSpec) -> Result<()> {
    let most_keypoints = recipe.max_keypoints(spec, options);
    if most_keypoints > MAX_KEYPOINTS_PER_UNIT {
        return Err(PackError::Options(format!(
            "the maximum number of keypoints must be at most {MAX_KEYPOINTS_PER_UNIT}, not {most_keypoints}"
        )));
    }
    for (what, dim, most) in [
        ("local", spec.descriptor_dim, MAX_DESCRIPTOR_DIM),
        ("global", spec.global_len(), MAX_GLOBAL_DIM),
    ] {
        if dim > most {
            return Err(PackError::Options(format!(
                "the model's {what} descriptors have {dim} numbers; those of a pack have at most {most}: choose another model"
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::cells::Cells;
    use crate::paper::PaperTiles;
    use proptest::prelude::*;

    /// A north-up map at 45 degrees north in UTM with pixels of these metres.
    fn utm(map_px: (u64, u64), x_m: f64, y_m: f64) -> Georeference {
        let affine =
            grimnet_geo::Affine::from_gdal([500_000.0, x_m, 0.0, 4_982_950.0, 0.0, -y_m]).unwrap();
        let crs = grimnet_geo::Crs::parse("EPSG:32632").unwrap();
        Georeference::new(affine, crs, map_px)
    }

    fn plan_with(
        map: &Georeference,
        map_px: (u64, u64),
        options: &BuildOptions,
    ) -> Result<Vec<LevelPlan>> {
        plan_levels(map, map_px, options, &Cells, &NetSpec::compact())
    }

    fn plan(map_px: (u64, u64), gsd_m: f64, options: &BuildOptions) -> LevelPlan {
        // The scale of UTM is 0.9996 at its central meridian.
        let options = BuildOptions {
            levels: Levels::Gsd(vec![gsd_m / 0.9996]),
            ..options.clone()
        };
        plan_with(&utm(map_px, gsd_m, gsd_m), map_px, &options)
            .unwrap()
            .remove(0)
    }

    #[test]
    fn small_maps_are_padded_on_both_sides() {
        let level = plan((100, 600), 0.3, &BuildOptions::standard());
        assert_eq!(
            (level.layout.tile_grid, level.layout.unit_grid),
            ([1, 2], [2, 3])
        );
        assert_eq!(level.layout.origin_px, [-206, -84]);
    }

    #[test]
    fn unequal_pixels_come_out_square() {
        let options = BuildOptions {
            levels: Levels::Gsd(vec![0.5]),
            ..BuildOptions::standard()
        };
        let level = plan_with(&utm((1000, 1000), 0.25, 0.5), (1000, 1000), &options)
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
            plan_with(&utm((999, 999), 0.3, 0.3), (999, 999), &options).is_err()
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
        // More levels than a pack is opened with.
        let many = |count: u32| Levels::Gsd((0..count).map(|i| 0.3 + f64::from(i)).collect());
        for (count, is_refused) in [(64, false), (65, true)] {
            let levels = many(count);
            assert_eq!(
                refused(BuildOptions {
                    levels,
                    ..standard()
                }),
                is_refused
            );
        }
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
        assert!(plan_with(&utm((9, 9), 0.3, 0.3), (0, 9), &standard()).is_err());
    }

    #[test]
    fn what_no_pack_is_opened_with_is_refused() {
        let is_planned = |max_keypoints: u32, spec: &NetSpec| {
            let options = BuildOptions {
                max_keypoints,
                ..BuildOptions::paper()
            };
            let recipe = PaperTiles {
                resolution_px: options.resolution,
            };
            let map_px = (999, 999);
            plan_levels(&utm(map_px, 0.3, 0.3), map_px, &options, &recipe, spec).is_ok()
        };
        let mut spec = NetSpec::compact();
        assert!(is_planned(MAX_KEYPOINTS_PER_UNIT, &spec));
        assert!(!is_planned(MAX_KEYPOINTS_PER_UNIT + 1, &spec));
        spec.descriptor_dim = MAX_DESCRIPTOR_DIM + 1;
        assert!(!is_planned(1024, &spec));
    }

    proptest! {
        #[test]
        fn every_map_pixel_is_in_a_tile_and_every_unit_in_one_item(
            width in 1u64..5000, height in 1u64..5000,
        ) {
            let level = plan((width, height), 0.3, &BuildOptions::standard());
            for a in 0..2 {
                let end = level.layout.origin_px[a] + i64::from(level.layout.tile_grid[a] + 1) * 256;
                prop_assert!(level.layout.origin_px[a] <= 0 && end >= level.size_px()[a] as i64);
                // No row or column of cells lies outside the map altogether but for maps below a cell.
                if level.size_px()[a] > 256 {
                    prop_assert!(level.layout.origin_px[a] > -128 && end - (level.size_px()[a] as i64) <= 128);
                }
            }
            let mut seen = vec![0u8; (level.layout.unit_grid[0] * level.layout.unit_grid[1]) as usize];
            for item in level.items(0) {
                for y in 0..item.count[1] {
                    for x in 0..item.count[0] {
                        let at = (item.first[1] + y) * level.layout.unit_grid[0] + item.first[0] + x;
                        seen[at as usize] += 1;
                    }
                }
            }
            prop_assert!(seen.iter().all(|&n| n == 1));
        }
    }
}
