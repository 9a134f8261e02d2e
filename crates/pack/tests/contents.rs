//! What a pack holds is what the network says about the map.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use grimnet_geo::{LevelPx, Raster, WindowPx};
use grimnet_net::{Dense, Domain, ExtractOptions, Extractor};
use grimnet_pack::quantise::descriptor_scale;
use grimnet_pack::{
    BuildOptions, CELL_PX, DescriptorType, Index, Level, Levels, Mode, PAPER_INDEX, Reach, TILE_PX,
    draw, resize_for_network,
};
use image::GrayImage;
use support::*;

fn cosine(a: &[f32], b: &[f32]) -> f32 {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
}

#[test]
fn tiles_and_features_lie_where_the_map_says() {
    let map = TestMap::new(1500, 1100);
    let pack = make_and_open(&map, &one_level());
    let mut progress = Vec::new();
    pack.verify(&mut |p| progress.push(p)).unwrap();
    let last = progress.last().unwrap();
    assert!(last.total_bytes > 0 && last.done_bytes == last.total_bytes);
    assert!(progress.is_sorted_by_key(|p| p.done_bytes));
    assert_eq!((pack.levels().len(), pack.mode()), (1, Mode::Default));
    let level = &pack.levels()[0];
    // 0.25 m of UTM are 0.25 / 0.9996 m of ground: 1501 x 1101 px of 0.25 m, so 6 x 5 cells.
    assert_eq!(level.size_px(), [1501, 1101]);
    assert_eq!(
        (level.manifest().unit_grid, level.tile_count()),
        ([6, 5], 20)
    );
    let tile = level.tile(7);
    assert_eq!((tile.grid, level.tile_at([2, 1])), ([2, 1], Some(7)));
    assert_eq!(tile.origin_px, [-17 + 2 * 256, -89 + 256]);
    let back = level
        .level_px_from_lonlat(level.lonlat_from_level_px(tile.centre_px).unwrap())
        .unwrap();
    assert!((back.x - tile.centre_px.x).abs() < 1e-3 && (back.y - tile.centre_px.y).abs() < 1e-3);
    let expected = map
        .georeference()
        .lonlat_from_map_px(tile.centre_map_px)
        .unwrap();
    let found = level.lonlat_from_level_px(tile.centre_px).unwrap();
    assert!((expected.lon_deg - found.lon_deg).abs() < 1e-12);
}

/// The network's pass over a tile and 64 pixels around it.
fn seen_around(
    map: &TestMap,
    level: &Level,
    extractor: &Extractor,
    tile: usize,
) -> (Dense, GrayImage) {
    let [x, y] = level.tile(tile).origin_px.map(|v| v as f64 - 64.0);
    let side = TILE_PX + 128;
    let window: WindowPx =
        level
            .frame()
            .map_window(LevelPx::new(x, y), f64::from(side), f64::from(side));
    let patch = map.read(window, side, side).unwrap();
    let dense = extractor.dense(&patch.rgb, Some(&patch.valid)).unwrap();
    (dense, patch.valid)
}

#[test]
fn features_are_those_of_a_pass_over_the_tile_alone() {
    let map = TestMap::new(1500, 1100);
    let pack = make_and_open(&map, &one_level());
    let level = &pack.levels()[0];
    let model = tiny_model(1);
    let extractor = Extractor::new(&model, Domain::Sat).unwrap();
    // Both see the same surroundings.
    let (dense, _) = seen_around(&map, level, &extractor, 7);
    let options = ExtractOptions {
        threshold: 0.001,
        max_keypoints: 256,
        nms_radius_px: 2,
    };
    let features = level.features(7).unwrap();
    let stored_descriptors = features.descriptors.to_f32();
    let step = descriptor_scale(16);
    assert!(features.scores.is_sorted_by(|a, b| a >= b));
    let mut matched = 0;
    for (cx, cy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let window = [64 + cx * CELL_PX, 64 + cy * CELL_PX, CELL_PX, CELL_PX];
        let keypoints = dense.keypoints(window, &options, None);
        let descriptors = dense.describe(&keypoints);
        for (keypoint, descriptor) in keypoints.iter().zip(descriptors.chunks_exact(16)) {
            let place = [keypoint.x_px - 64.0, keypoint.y_px - 64.0];
            let Some(i) = features.xy_px.iter().position(|xy| *xy == place) else {
                continue;
            };
            let stored = &stored_descriptors[16 * i..16 * i + 16];
            // Half a step of rounding, and what the network sees beyond the halo.
            let apart = |(a, b): (&f32, &f32)| (a - b).abs();
            let apart = stored.iter().zip(descriptor).map(apart).fold(0.0, f32::max);
            assert!(apart < step * 0.6 + 0.002, "{apart}");
            assert!((features.scores[i] - keypoint.score).abs() < 0.002);
            matched += 1;
        }
    }
    assert!(
        matched > features.len() * 9 / 10,
        "{matched} of {}",
        features.len()
    );
    let strongest = level.strongest_features(7, 50).unwrap();
    assert_eq!(strongest.len(), 50);
    assert_eq!(strongest.xy_px[..], features.xy_px[..50]);
    let blocks = level.blocks(7).unwrap();
    assert_eq!(
        blocks.iter().map(|b| b.len()).sum::<usize>(),
        features.len()
    );
}

#[test]
fn descriptors_of_tiles_are_sums_without_their_common_part() {
    let map = TestMap::new(1500, 1100);
    let pack = make_and_open(&map, &one_level());
    let level = &pack.levels()[0];
    let model = tiny_model(1);
    let extractor = Extractor::new(&model, Domain::Sat).unwrap();
    let globals: Vec<Vec<f32>> = (0..level.tile_count())
        .map(|tile| {
            let (dense, valid) = seen_around(&map, level, &extractor, tile);
            model.global_descriptor(&dense.vlad([64, 64, TILE_PX, TILE_PX], Some(&valid)))
        })
        .collect();
    let count = globals.len() as f32 + 1.0;
    let common = |axis: usize| globals.iter().map(|row| row[axis]).sum::<f32>() / count;
    let common: Vec<f32> = (0..level.global_dim()).map(common).collect();
    for (tile, global) in globals.iter().enumerate() {
        let own: Vec<f32> = global.iter().zip(&common).map(|(x, c)| x - c).collect();
        let alike = cosine(&own, &level.global(tile));
        assert!(alike > 0.995, "tile {tile}: {alike}");
    }
    let hits = &level.search(&level.global(7), 3, None).unwrap()[0];
    assert_eq!(hits[0].tile, 7);
    assert!((hits[0].similarity - 1.0).abs() < 1e-3);
}

#[test]
fn nothing_of_the_map_is_lost_and_small_maps_are_padded() {
    for (width, height) in [(1500, 1100), (300, 90), (513, 2000)] {
        let map = TestMap::new(width, height);
        let pack = make_and_open(&map, &one_level());
        let level = &pack.levels()[0];
        let mut covered = [[i64::MAX, i64::MIN]; 2];
        for i in 0..level.tile_count() {
            for (a, covered) in covered.iter_mut().enumerate() {
                let start = level.tile(i).origin_px[a];
                covered[0] = covered[0].min(start);
                covered[1] = covered[1].max(start + i64::from(TILE_PX));
            }
            // Keypoints lie on the map, not on the padding.
            let tile = level.tile(i);
            for [x, y] in level.features(i).unwrap().xy_px {
                let place = level.map_px_from_level_px(LevelPx::new(
                    tile.origin_px[0] as f64 + f64::from(x) + 0.5,
                    tile.origin_px[1] as f64 + f64::from(y) + 0.5,
                ));
                assert!(
                    place.x >= 0.0
                        && place.x <= width as f64
                        && place.y >= 0.0
                        && place.y <= height as f64
                );
            }
        }
        for (a, covered) in covered.iter().enumerate() {
            assert!(
                covered[0] <= 0 && covered[1] >= level.size_px()[a] as i64,
                "{width} x {height}: {covered:?}"
            );
        }
    }
}

#[test]
fn nodata_and_black_are_skipped_and_counted() {
    let mut map = TestMap::new(2048, 2048);
    map.nodata_left = 1024;
    map.black_top = 1024;
    let pack = make_and_open(&map, &one_level());
    let m = pack.levels()[0].manifest();
    assert_eq!(
        m.tiles + m.tiles_skipped,
        u64::from(m.tile_grid[0] * m.tile_grid[1])
    );
    assert_eq!(
        m.units + m.units_skipped,
        u64::from(m.unit_grid[0] * m.unit_grid[1])
    );
    // A quarter of the map is left: 5 of 9 cells a side at most.
    assert!(m.units <= 25 && m.units >= 16, "{} cells", m.units);
    assert!(
        m.tiles <= 25 && m.tiles >= 12 && m.tiles_skipped >= 39,
        "{} tiles",
        m.tiles
    );
    for i in 0..pack.levels()[0].tile_count() {
        let tile = pack.levels()[0].tile(i);
        assert!(tile.centre_map_px.x > 1024.0 - 200.0 && tile.centre_map_px.y > 1024.0 - 200.0);
    }
    let picture = draw(&pack, 0, &map).unwrap();
    let has = |colour: [u8; 3]| picture.pixels().any(|p| p.0 == colour);
    assert!(has([255, 200, 40]) && has([230, 40, 60]));
    assert!(draw(&pack, 1, &map).is_err());
    assert!(draw(&pack, 0, &TestMap::new(64, 64)).is_err());
}

#[test]
fn paper_mode_keeps_tiles_independent() {
    let map = TestMap::new(1500, 1100);
    let pack = make_and_open(&map, &paper());
    let level = &pack.levels()[0];
    assert_eq!(
        (level.manifest().tile_grid, level.tile_count()),
        ([4, 3], 12)
    );
    let tile = level.tile(5);
    assert_eq!((tile.grid, tile.origin_px), ([1, 1], [256, 256]));
    let features = level.features(5).unwrap();
    assert!(features.len() <= 64 && !features.is_empty());
    assert!(
        features
            .xy_px
            .iter()
            .flatten()
            .all(|&v| (-0.5..512.0).contains(&v))
    );
    // Each position is the centre of a pixel of the 96 px picture.
    let network_px = |v: f32| (v + 0.5) * 96.0 / 512.0 - 0.5;
    assert!(
        features
            .xy_px
            .iter()
            .flatten()
            .all(|&v| (network_px(v) - network_px(v).round()).abs() < 0.02)
    );
    assert_eq!(level.blocks(5).unwrap().len(), 1);
    assert_eq!(
        level.search(&level.global(5), 1, None).unwrap()[0][0].tile,
        5
    );
    // Descriptors are those of the network, not rounded.
    assert_eq!(level.descriptor_type(), DescriptorType::Float32);
    let model = tiny_model(1);
    let extractor = Extractor::new(&model, Domain::Sat).unwrap();
    let window = WindowPx::new(256.0, 256.0, 512.0, 512.0);
    let cut = map.read(window, 512, 512).unwrap();
    let seen = resize_for_network(&cut.rgb, 96);
    let options = ExtractOptions {
        threshold: 0.001,
        max_keypoints: 64,
        nms_radius_px: 2,
    };
    let expected = extractor.extract(&seen, None, &options).unwrap();
    assert_eq!(features.descriptors.to_f32(), expected.descriptors);
    assert_eq!(level.global(5), expected.global);
    let note = format!("{}", pack.info());
    assert!(
        note.contains("at least 256 tiles") && note.contains("paper mode"),
        "{note}"
    );
    // A pack says where its network is not the paper's.
    let [local, of_tile] = [
        features.descriptors.to_f32().len() / features.len(),
        expected.global.len(),
    ];
    let dims = format!(
        "local descriptors of {local} values, tile descriptors of {of_tile}: the paper's procedure with another network"
    );
    assert!(note.contains(&dims), "{note}");
}

#[test]
fn levels_go_by_factors_of_two() {
    let map = TestMap::new(2500, 2300);
    let pack = make_and_open(
        &map,
        &BuildOptions {
            levels: Levels::Auto,
            ..one_level()
        },
    );
    let gsds: Vec<f64> = pack.levels().iter().map(|l| l.gsd_m()).collect();
    assert_eq!(gsds.len(), 4, "{gsds:?}");
    assert!(
        (gsds[0] - 0.2501).abs() < 1e-4
            && gsds.windows(2).all(|w| (w[1] / w[0] - 2.0).abs() < 1e-9)
    );
    assert_eq!(pack.nearest_level(0.6), 1);
    assert_eq!(pack.nearest_level(90.0), 3);
    // Each level covers the same ground.
    for level in pack.levels() {
        let corner = level.map_px_from_level_px(LevelPx::new(0.0, level.size_px()[1] as f64));
        assert!(corner.x == 0.0 && (corner.y - 2300.0).abs() < 9.0);
    }
}

#[test]
fn adapted_statistics_are_stored_and_used() {
    let map = TestMap::new(1200, 900);
    let plain = make_and_open(&map, &one_level());
    let adapted = make_and_open(
        &map,
        &BuildOptions {
            adapt: true,
            ..one_level()
        },
    );
    assert!(plain.levels()[0].statistics().unwrap().is_none());
    let level = &adapted.levels()[0];
    let statistics = level.statistics().unwrap().unwrap();
    assert_eq!(statistics.model(), tiny_model(1).hash());
    assert!(level.manifest().adapted_from_tiles > 5);
    assert_ne!(level.global(3), plain.levels()[0].global(3));
    assert!(adapted.info().to_string().contains("statistics adapted on"));
}

#[test]
fn search_filters_and_takes_several_queries() {
    let map = TestMap::new(1500, 1100);
    let pack = make_and_open(&map, &one_level());
    let level = &pack.levels()[0];
    let queries = [level.global(3), level.global(11)].concat();
    let hits = level.search(&queries, 4, Some(&|tile| tile != 3)).unwrap();
    assert_eq!(hits.len(), 2);
    assert!(hits[0].iter().all(|h| h.tile != 3) && hits[1][0].tile == 11 && hits[0].len() == 4);
    assert!(
        hits.iter()
            .all(|h| h.is_sorted_by(|a, b| a.similarity >= b.similarity))
    );
    assert_eq!(
        level.search(&queries, 1000, None).unwrap()[0].len(),
        level.tile_count()
    );
    assert!(level.search(&queries[1..], 4, None).is_err());
    assert_eq!(level.index(), Index::Exact);
    let error = level
        .search_with(PAPER_INDEX, &queries, 4, None)
        .unwrap_err();
    assert!(error.to_string().contains("without IVF256"), "{error}");
}

/// The lists that are visited hold a part of all tiles, and perhaps none of the few that are allowed.
#[test]
fn every_allowed_tile_is_found_whatever_lists_are_visited() {
    let map = TestMap::new(5000, 4400);
    let index = Index::IvfPq {
        nlist: 16,
        subquantisers: 8,
        nprobe: 1,
        rerank_factor: 4,
    };
    let options = BuildOptions {
        index: Some(index),
        ..one_level()
    };
    let pack = make_and_open(&map, &options);
    let level = &pack.levels()[0];
    assert_eq!(level.index(), index);
    let query = level.global(0);
    let everywhere = level.search(&query, 1000, None).unwrap();
    assert!(everywhere[0].len() < level.tile_count() / 2);
    let allowed = |tile: usize| tile.is_multiple_of(40);
    let found = level.search(&query, 1000, Some(&allowed)).unwrap();
    assert_eq!(found[0].len(), level.tile_count().div_ceil(40));
    assert!(found[0].iter().all(|hit| allowed(hit.tile)));
    let exact = level
        .search_with(Index::Exact, &query, 1000, Some(&allowed))
        .unwrap();
    assert_eq!(found, exact);
}

#[test]
fn an_index_that_cannot_be_trained_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let index = |nlist, subquantisers| {
        let index = Index::IvfPq {
            nlist,
            subquantisers,
            nprobe: 1,
            rerank_factor: 4,
        };
        let options = BuildOptions {
            index: Some(index),
            ..one_level()
        };
        let map = TestMap::new(600, 500);
        let mut none = |_: &_| unreachable!("nothing is to be computed");
        let error = grimnet_pack::build(&map, &tiny_model(1), &options, &out, &mut none);
        error.unwrap_err().to_string()
    };
    let few_tiles = index(4096, 8);
    assert!(few_tiles.contains("at least 4096 tiles"), "{few_tiles}");
    let uneven = index(16, 7);
    assert!(uneven.contains("7 subquantisers"), "{uneven}");
    assert_eq!(folder.path().read_dir().unwrap().count(), 0);
}

#[test]
fn keypoints_of_the_map_are_found_where_they_lie() {
    let map = TestMap::new(1500, 1100);
    let pack = make_and_open(&map, &indexed());
    pack.verify(&mut |_| ()).unwrap();
    let level = &pack.levels()[0];
    let index = level.keypoint_index().unwrap();
    let tile = level.tile(7);
    let features = level.features(7).unwrap();
    let mut lowest = vec![f64::INFINITY; features.len()];
    let reach = Reach {
        lists: 3,
        neighbours: 5,
    };
    let descriptors = features.descriptors.to_f32();
    index.search(&descriptors, reach, None, |neighbour| {
        let [x, y] = features.xy_px[neighbour.descriptor].map(|along| f64::from(along) + 0.5);
        let away = [
            neighbour.position.x - tile.origin_px[0] as f64 - x,
            neighbour.position.y - tile.origin_px[1] as f64 - y,
        ];
        let away = away[0].abs().max(away[1].abs());
        let lowest = &mut lowest[neighbour.descriptor];
        *lowest = lowest.min(away);
    });
    let found = lowest.iter().filter(|&&away| away <= 4.0).count();
    assert!(
        found * 100 >= lowest.len() * 99,
        "{found} of {}",
        lowest.len()
    );
    assert_eq!(level.tile_around(tile.centre_px), Some(7));
    assert_eq!(
        level.tile_around(LevelPx { x: -1e9, y: -1e9 }),
        level.tile_at([0, 0])
    );
    assert!(
        pack.info().to_string().contains("keypoints indexed"),
        "{}",
        pack.info()
    );
    let plain = make_and_open(&map, &one_level());
    assert!(plain.levels()[0].keypoint_index().is_none());
}

#[test]
fn a_cell_stays_below_its_budget() {
    // The shapes of the compact preset decide; its numbers do not.
    let mut spec = grimnet_net::NetSpec::compact();
    for (stage, width) in spec.stages.iter_mut().zip([4, 8, 16, 16, 16]) {
        stage.widths = vec![width];
    }
    spec.decoder = grimnet_net::Decoder::Lateral { width: 16 };
    let model = grimnet_net::Model::random(&spec, 3).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let options = BuildOptions {
        keypoint_threshold: 0.0,
        ..one_level()
    };
    grimnet_pack::build(
        &TestMap::new(2048, 2048),
        &model,
        &options,
        &out,
        &mut |_| {},
    )
    .unwrap();
    let info = grimnet_pack::Pack::open(&out).unwrap().info();
    let level = &info.levels[0];
    assert!(level.keypoints_per_unit > 200.0, "{level:?}");
    assert!(
        info.len_bytes as f64 / level.units as f64 <= 40.0 * 1024.0,
        "{level:?}"
    );
}
