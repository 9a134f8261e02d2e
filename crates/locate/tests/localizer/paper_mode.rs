//! The publication's procedure from end to end.

use super::*;

fn paper_localizer(options: Options) -> Localizer {
    let pack = Pack::open(&scene().paper_pack).unwrap();
    Localizer::new(Model::bundled().unwrap(), pack)
        .unwrap()
        .with_options(options)
}

/// Right and down from a tile's centre in pixels, heading in degrees, size in pixels, scale.
type PaperCrop = (f64, f64, f64, (u32, u32), f64);

/// Crops for paper mode, whose tiles are 512 map pixels: about that extent, off every tile's centre, turned, and at another scale.
const PAPER_CROPS: [PaperCrop; 4] = [
    (67.0, -82.5, 9.0, (512, 512), 1.08),
    (-91.25, 58.0, -10.0, (512, 512), 0.92),
    (54.0, 90.0, 6.0, (512, 512), 1.14),
    (-60.0, -75.0, -7.0, (640, 480), 0.85),
];

#[test]
fn paper_mode_maps_off_centre_turned_and_scaled_crops() {
    let localizer = paper_localizer(Options::paper());
    let by_georeference = paper_localizer(Options {
        coordinates: Coordinates::Georeference,
        ..Options::paper()
    });
    let level = &localizer.pack().levels()[0];
    // Tiles are cut from the map's own pixels.
    assert_eq!(level.size_px(), [u64::from(MAP_PX.0), u64::from(MAP_PX.1)]);
    assert_eq!(level.frame().map_px_per_level_px_x, 1.0);
    let tile = level.tile(level.tile_at([2, 1]).unwrap());
    for (right_px, down_px, heading_deg, size_px, scale) in PAPER_CROPS {
        let centre = MapPx::new(
            tile.centre_map_px.x + right_px,
            tile.centre_map_px.y + down_px,
        );
        let query = photo_of(&scene().picture, centre, heading_deg, size_px, scale);
        let outcome = localizer.locate(&query, &Prior::none()).unwrap();
        let error_m = error_m(&outcome, centre);
        let fix = outcome.fix().unwrap();
        assert!(error_m < 1.5, "{error_m} m");
        // No tile's centre is near, so only the homography and eq. 22 and 23 can lead there.
        for i in 0..level.tile_count() {
            let at = truth(level.tile(i).centre_map_px);
            assert!(distance_m(at, truth(centre)) > 20.0);
        }
        // On a map this small the equations and the georeference agree.
        let exact = by_georeference.locate(&query, &Prior::none()).unwrap();
        let [a, b] = [&outcome, &exact].map(|outcome| {
            let fix = outcome.fix().unwrap();
            LonLat::new(fix.lon_deg, fix.lat_deg)
        });
        assert!(distance_m(a, b) < 0.05, "{} m", distance_m(a, b));
        let off_deg = turn_deg(heading_deg + north_deg(centre), fix.heading_deg.unwrap());
        assert!(off_deg.abs() < 1.5, "{off_deg} degrees");
        assert!(
            (fix.gsd_m / (GSD_M * scale) - 1.0).abs() < 0.02,
            "{}",
            fix.gsd_m
        );
    }
}

#[test]
fn paper_mode_answers_with_the_homography_of_four_inliers() {
    // With this threshold no homography has more inliers than the four pairs of its sample.
    let options = Options::paper();
    let localizer = paper_localizer(Options {
        ransac: Ransac {
            threshold_px: 1e-7,
            ..options.ransac
        },
        ..options
    });
    let level = &localizer.pack().levels()[0];
    let tile = level.tile(level.tile_at([2, 1]).unwrap());
    let centre = MapPx::new(tile.centre_map_px.x + 67.0, tile.centre_map_px.y - 82.5);
    let query = photo_of(&scene().picture, centre, 4.0, (512, 512), 1.05);
    let outcome = localizer.locate(&query, &Prior::none()).unwrap();
    let fix = outcome.fix().unwrap();
    assert_eq!(fix.inliers, 4);
    assert!(fix.heading_deg.is_some());
    let answer = LonLat::new(fix.lon_deg, fix.lat_deg);
    let of_tile = truth(level.tile(fix.tile.index).centre_map_px);
    assert!(distance_m(answer, of_tile) > 0.1);
    // The covariance is that of the four pairs, not of a position anywhere in the tile.
    let anywhere_m2 = level.tile_m().powi(2) / 12.0;
    assert!(fix.covariance_en_m2[0] > 0.0);
    assert!((fix.covariance_en_m2[0] / anywhere_m2 - 1.0).abs() > 0.01);
}

#[test]
fn paper_mode_answers_always_and_wants_a_paper_pack() {
    let (place, _) = PLACES[1];
    let localizer = paper_localizer(Options::paper());
    let wrong = localizer
        .locate(&photo(&town(2), place, 0.0), &Prior::none())
        .unwrap();
    let fix = wrong.fix().unwrap();
    assert!(fix.lat_deg.is_finite() && fix.lon_deg.is_finite() && fix.radius95_m.is_finite());
    assert_eq!(fix.confidence, None);

    let refused =
        self::localizer(Options::paper()).locate(&photo(&town(2), place, 0.0), &Prior::none());
    assert!(matches!(refused, Err(LocateError::NotAPaperPack { .. })));
}

/// Without a homography the answer is the centre of a tile, whose coordinates are those of eq. 2a and 2b.
#[test]
fn paper_mode_places_the_centre_of_a_tile_by_the_papers_equations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("town.png");
    scene().picture.save(&path).unwrap();
    // 200 km west of the central meridian the columns of the map are two degrees off the meridian.
    let world = format!("{GSD_M}\n0\n0\n-{GSD_M}\n300000\n5400000\n");
    std::fs::write(folder.path().join("town.pgw"), world).unwrap();
    let options = MapOptions {
        crs: Some("EPSG:32633".into()),
        ..MapOptions::default()
    };
    let map = open_map(&path, &options).unwrap();
    let pack = folder.path().join("paper.grim");
    let model = Model::bundled().unwrap();
    build(
        map.as_ref(),
        &model,
        &BuildOptions::paper(),
        &pack,
        &mut |_| (),
    )
    .unwrap();
    let of_px = |x: f64, y: f64| {
        let georeference = map.georeference();
        georeference.lonlat_from_map_px(MapPx::new(x, y)).unwrap()
    };
    // The upper left tile.
    let query = photo_of(
        &scene().picture,
        MapPx::new(256.0, 256.0),
        0.0,
        (512, 512),
        1.0,
    );
    let answer = |coordinates| {
        let localizer = localizer_of(
            &pack,
            Options {
                coordinates,
                // No match is that clear.
                max_ratio: Some(1e-6),
                ..Options::paper()
            },
        );
        let outcome = localizer.locate(&query, &Prior::none()).unwrap();
        let fix = outcome.fix().unwrap();
        let level = &localizer.pack().levels()[0];
        assert_eq!(level.tile(fix.tile.index).grid, [0, 0]);
        assert_eq!(fix.inliers, 0);
        LonLat::new(fix.lon_deg, fix.lat_deg)
    };
    let (width, height) = (f64::from(MAP_PX.0), f64::from(MAP_PX.1));
    let (ll, ur) = (of_px(0.0, height), of_px(width, 0.0));
    let by_equations = LonLat::new(
        ll.lon_deg + 256.0 / width * (ur.lon_deg - ll.lon_deg),
        ur.lat_deg - 256.0 / height * (ur.lat_deg - ll.lat_deg),
    );
    assert!(distance_m(answer(Coordinates::PaperCorners), by_equations) < 1e-3);
    let exact = of_px(256.0, 256.0);
    assert!(distance_m(answer(Coordinates::Georeference), exact) < 1e-3);
    assert!(distance_m(by_equations, exact) > 5.0);
}

#[test]
fn paper_mode_neither_uses_nor_claims_to_use_what_is_known_of_the_view() {
    let (place, _) = PLACES[1];
    let query = photo(&town(2), place, 0.0);
    let localizer = paper_localizer(Options::paper());
    let given = Prior::none().with_heading(90.0, 5.0).with_gsd_m(GSD_M);
    let [with, without] =
        [given, Prior::none()].map(|prior| localizer.locate(&query, &prior).unwrap());
    let [with, without] = [&with, &without].map(|outcome| outcome.fix().unwrap());
    assert_eq!(
        (with.lat_deg, with.lon_deg, with.inliers),
        (without.lat_deg, without.lon_deg, without.inliers)
    );
    assert!(with.evidence.used.is_empty(), "{:?}", with.evidence.used);
    assert!(with.evidence.set_aside.len() > without.evidence.set_aside.len());
}

#[test]
fn statistics_of_a_flight_are_those_of_the_photos_as_paper_mode_sees_them() {
    let (place, _) = PLACES[1];
    let query = photo(&scene().picture, place, 0.0);
    // The most similar tile alone, so that it is the answer's.
    let options = |adapt| Options {
        top_k: 1,
        adapt,
        ..Options::paper()
    };
    let similarity = |localizer: Localizer| {
        let outcome = localizer.locate(&query, &Prior::none()).unwrap();
        outcome.fix().unwrap().tile.similarity
    };
    let given = Prior::none()
        .with_heading(90.0, 5.0)
        .with_gsd_m(2.0 * PHOTO_GSD_M);
    let [with, without] = [given, Prior::none()].map(|prior| {
        let localizer = paper_localizer(options(Adapt::None));
        similarity(localizer.adapted_to_flight([(&query, &prior)]).unwrap())
    });
    assert_eq!(with, without);
    assert_ne!(with, similarity(paper_localizer(options(Adapt::None))));
    // The same statistics, but for rounding.
    let of_photo = similarity(paper_localizer(options(Adapt::Photo)));
    assert!((with - of_photo).abs() < 1e-3, "{with} and {of_photo}");
}

#[test]
fn default_mode_votes_on_a_pack_of_paper_mode_at_the_resolution_of_its_tiles() {
    // The network saw each tile of 512 map pixels as 320, and sees a photo at the same resolution.
    let localizer = paper_localizer(Options::default());
    for (place, heading_deg) in PLACES {
        let photo = photo(&scene().picture, place, heading_deg);
        let outcome = localizer
            .locate(&photo, &known_view(place, heading_deg))
            .unwrap();
        assert!(error_m(&outcome, place) < 1.0);
        let fix = outcome.fix().unwrap();
        // In map pixels hardly two matches have the same translation: 16 to 21 votes.
        assert!(fix.tile.votes > 50, "{} votes", fix.tile.votes);
    }
}
