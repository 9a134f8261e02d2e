//! Default mode from end to end.

use super::*;

#[test]
fn guidance_finds_more_matches_of_the_same_place() {
    let [guided, plain] = [true, false].map(|guided| {
        localizer(Options {
            guided,
            ..Options::default()
        })
    });
    let (mut more, mut before) = (0, 0);
    for (place, heading_deg) in PLACES {
        let photo = photo(&scene().picture, place, heading_deg);
        let prior = known_view(place, heading_deg);
        let outcome = guided.locate(&photo, &prior).unwrap();
        assert!(error_m(&outcome, place) < 1.0);
        more += outcome.fix().unwrap().inliers;
        before += plain
            .locate(&photo, &prior)
            .unwrap()
            .fix()
            .map_or(0, |fix| fix.inliers);
    }
    assert!(more > before, "{more} after {before}");
}

#[test]
fn known_heading_gives_place_heading_scale_and_a_fair_radius() {
    let localizer = localizer(Options {
        keep_matches: true,
        ..Options::default()
    });
    for (place, heading_deg) in PLACES {
        let photo = photo(&scene().picture, place, heading_deg);
        let prior = known_view(place, heading_deg + 3.0);
        let outcome = localizer.locate(&photo, &prior).unwrap();
        let error_m = error_m(&outcome, place);
        let fix = outcome.fix().unwrap();
        assert!(error_m < 1.0, "{error_m} m");
        assert!(
            error_m <= fix.radius95_m && fix.radius95_m < 5.0,
            "{error_m} m, stated {}",
            fix.radius95_m
        );
        let off_deg = turn_deg(heading_deg + north_deg(place), fix.heading_deg.unwrap());
        assert!(off_deg.abs() < 1.0, "{off_deg} degrees");
        assert!(
            (fix.gsd_m / PHOTO_GSD_M - 1.0).abs() < 0.01,
            "{}",
            fix.gsd_m
        );
        assert_eq!(fix.outline_lon_lat_deg.len(), 4);
        let across = [0, 1]
            .map(|i| LonLat::new(fix.outline_lon_lat_deg[i][0], fix.outline_lon_lat_deg[i][1]));
        let width_m = f64::from(PHOTO_PX.0) * PHOTO_GSD_M;
        assert!((distance_m(across[0], across[1]) / width_m - 1.0).abs() < 0.02);
        assert!(fix.matches >= fix.inliers && fix.inliers > 20);
        let drawn = draw(
            &photo,
            &outcome,
            Some(scene().map.as_ref()),
            &DrawOptions::default(),
        )
        .unwrap();
        assert_eq!(drawn.height(), 640);
    }
}

#[test]
fn unknown_heading_and_scale_are_found() {
    let localizer = localizer(Options::default());
    let (place, heading_deg) = PLACES[1];
    let photo = photo(&scene().picture, place, heading_deg);
    let known_scale = Prior::none().with_gsd_m(PHOTO_GSD_M);
    for prior in [known_scale, Prior::none()] {
        let outcome = localizer.locate(&photo, &prior).unwrap();
        assert!(error_m(&outcome, place) < 2.0);
        let found_deg = outcome.fix().unwrap().heading_deg.unwrap();
        assert!(turn_deg(heading_deg, found_deg).abs() < 3.0);
    }
}

/// Each half of the photo fits its own place: neither is the answer.
#[test]
fn a_photo_of_two_places_gets_no_fix() {
    let localizer = localizer(Options::default());
    let [(left, _), (right, _), ..] = PLACES;
    let mut picture = photo(&scene().picture, left, 0.0).image;
    let half = photo(&scene().picture, right, 0.0);
    for (x, y, pixel) in half.image.enumerate_pixels() {
        if x >= PHOTO_PX.0 / 2 {
            picture.put_pixel(x, y, *pixel);
        }
    }
    let photo = Photo::from_image(picture, Metadata::default());
    let unknown = Prior::none().with_gsd_m(PHOTO_GSD_M);
    for prior in [unknown, known_view(left, 0.0)] {
        let outcome = localizer.locate(&photo, &prior).unwrap();
        assert!(outcome.fix().is_none(), "{outcome:?}");
    }
}

/// An uncertain heading that is wrong costs no fix at whatever ground width.
#[test]
fn a_wrong_image_direction_costs_no_fix() {
    let localizer = localizer(Options::default());
    let (place, heading_deg) = PLACES[1];
    // 100 m across: the third of the widths that are tried.
    let scale = 100.0 / f64::from(PHOTO_PX.0) / GSD_M;
    let mut photo = photo_of(&scene().picture, place, heading_deg, PHOTO_PX, scale);
    photo.metadata.image_direction = Some(ImageDirection {
        bearing_deg: heading_deg - 180.0,
        magnetic: false,
    });
    let outcome = localizer.locate(&photo, &Prior::none()).unwrap();
    assert!(error_m(&outcome, place) < 2.0);
    let found_deg = outcome.fix().unwrap().heading_deg.unwrap();
    assert!(turn_deg(heading_deg, found_deg).abs() < 3.0);
}

/// The height above the take-off point says little of the ground width over hills.
#[test]
fn a_wrong_height_above_the_take_off_point_costs_no_fix() {
    let localizer = localizer(Options::default());
    let (place, heading_deg) = PLACES[1];
    let mut photo = photo(&scene().picture, place, heading_deg);
    let height_m = f64::from(PHOTO_PX.0) * PHOTO_GSD_M;
    for factor in [0.35, 1.0, 2.8] {
        photo.metadata.calibrated_focal_px = Some(f64::from(PHOTO_PX.0));
        photo.metadata.relative_altitude_m = Some(factor * height_m);
        for prior in [Prior::none(), Prior::none().with_heading(heading_deg, 3.0)] {
            let outcome = localizer.locate(&photo, &prior).unwrap();
            assert!(error_m(&outcome, place) < 2.0, "{factor}: {outcome:?}");
            let assumed = outcome.fix().unwrap().evidence.assumed.as_deref();
            let is_stated = assumed.unwrap().contains("metadata");
            assert_eq!(is_stated, factor == 1.0, "{assumed:?}");
        }
    }
}

#[test]
fn other_places_and_empty_photos_have_no_fix() {
    let localizer = localizer(Options {
        keep_matches: true,
        ..Options::default()
    });
    let prior = Prior::none().with_gsd_m(PHOTO_GSD_M);
    let elsewhere = photo(&town(2), PLACES[0].0, 10.0);
    for prior in [prior, prior.with_heading(10.0, 3.0)] {
        let outcome = localizer.locate(&elsewhere, &prior).unwrap();
        let Outcome::NoFix(no_fix) = &outcome else {
            panic!("{outcome:?}")
        };
        assert!(matches!(no_fix.reason, Reason::Rejected(_)), "{no_fix}");
        assert!(draw(&elsewhere, &outcome, None, &DrawOptions::default()).is_ok());
    }
    // Water, a capped lens, snow.
    for colour in [[30, 60, 80], [0, 0, 0], [255, 255, 255]] {
        let plain = RgbImage::from_pixel(640, 400, Rgb(colour));
        let plain = Photo::from_image(plain, Metadata::default());
        let Outcome::NoFix(no_fix) = localizer.locate(&plain, &prior).unwrap() else {
            panic!("{colour:?} was found")
        };
        assert_eq!(no_fix.reason, Reason::TooFewKeypoints { found: 0 });
    }
    // As if it had been taken from a twentieth of its height.
    let near = Prior::none().with_gsd_m(PHOTO_GSD_M / 20.0);
    let sharp = photo(&town(1), PLACES[0].0, 10.0);
    let Outcome::NoFix(no_fix) = localizer.locate(&sharp, &near).unwrap() else {
        panic!("a photo of a few pixels was found")
    };
    assert!(
        matches!(no_fix.reason, Reason::TooFewPixels { side_px } if side_px < 64.0),
        "{no_fix}"
    );
    // As if centimetres had been given for metres.
    let far = Prior::none().with_gsd_m(PHOTO_GSD_M * 1000.0);
    let Outcome::NoFix(no_fix) = localizer.locate(&sharp, &far).unwrap() else {
        panic!("a photo of a whole country was found")
    };
    assert!(
        matches!(no_fix.reason, Reason::TooMuchGround { across_px } if across_px > 8.0),
        "{no_fix}"
    );
    let tiny = Photo::from_image(RgbImage::new(1, 1), Metadata::default());
    assert!(localizer.locate(&tiny, &prior).unwrap().fix().is_none());
}

#[test]
fn an_area_restricts_the_answer() {
    let localizer = localizer(Options::default());
    let (place, heading_deg) = PLACES[0];
    let photo = photo(&scene().picture, place, heading_deg);
    let prior = Prior::none()
        .with_gsd_m(PHOTO_GSD_M)
        .with_heading(heading_deg, 3.0);
    let here = localizer
        .locate(&photo, &prior.near(truth(place), 30.0))
        .unwrap();
    assert!(error_m(&here, place) < 2.0);
    let beside = localizer
        .locate(
            &photo,
            &prior.near(truth(MapPx::new(place.x + 250.0, place.y)), 40.0),
        )
        .unwrap();
    let Outcome::NoFix(beside) = beside else {
        panic!("found outside of the area")
    };
    assert_eq!(beside.reason, Reason::Rejected(Rejection::OutsideArea));
    let far = localizer
        .locate(&photo, &prior.near(LonLat::new(0.0, 0.0), 1000.0))
        .unwrap();
    let Outcome::NoFix(no_fix) = far else {
        panic!("found far away")
    };
    assert_eq!(no_fix.reason, Reason::NoTiles);
}

#[test]
fn answers_depend_on_the_photos_that_normalisation_statistics_come_from() {
    let (place, heading_deg) = PLACES[0];
    let query = photo(&scene().picture, place, heading_deg);
    let other = photo(&town(2), PLACES[1].0, 80.0);
    let prior = Prior::none()
        .with_gsd_m(PHOTO_GSD_M)
        .with_heading(heading_deg, 3.0);
    let adapted_to = |photos: &[&Photo]| {
        let flight = localizer(Options::default())
            .adapted_to_flight(photos.iter().map(|photo| (*photo, &prior)))
            .unwrap();
        assert_eq!(flight.options().adapt, Adapt::Flight);
        flight
    };
    let answers: Vec<Outcome> = [
        localizer(Options::default()),
        localizer(Options {
            adapt: Adapt::Photo,
            ..Options::default()
        }),
        adapted_to(&[&query]),
        adapted_to(&[&other]),
        adapted_to(&[&query, &other]),
    ]
    .iter()
    .map(|localizer| localizer.locate(&query, &prior).unwrap())
    .collect();
    for (i, answer) in answers.iter().enumerate() {
        assert!(error_m(answer, place) < 2.0, "{i}");
        // Other statistics give other descriptors.
        let similarity = |outcome: &Outcome| outcome.fix().unwrap().tile.similarity;
        for before in &answers[..i] {
            assert_ne!(similarity(answer), similarity(before), "{i}");
        }
    }
    let none: [(&Photo, &Prior); 0] = [];
    assert!(
        localizer(Options::default())
            .adapted_to_flight(none)
            .is_err()
    );
}

#[test]
fn every_scale_is_tried_with_few_candidates_before_any_with_all() {
    const FIRST: usize = 2;
    let localizer = localizer(Options {
        stages: vec![FIRST],
        max_matched: FIRST,
        min_matched: 1,
        ..Options::default()
    });
    let (place, heading_deg) = PLACES[1];
    // 100 m across: the third of the widths that are tried.
    let scale = 100.0 / f64::from(PHOTO_PX.0) / GSD_M;
    let matched = |picture: &RgbImage| -> (bool, Vec<usize>) {
        let photo = photo_of(picture, place, heading_deg, PHOTO_PX, scale);
        let (outcome, trace) = localizer.locate_traced(&photo, &Prior::none()).unwrap();
        let counts = trace.rounds.iter().map(|round| round.matched.len());
        (outcome.fix().is_some(), counts.collect())
    };
    let (found, counts) = matched(&scene().picture);
    assert!(found && counts.len() > 1, "{counts:?}");
    assert!(counts.iter().all(|&count| count <= FIRST), "{counts:?}");
    let (found, counts) = matched(&town(2));
    assert!(!found);
    assert!(counts.iter().any(|&count| count > FIRST), "{counts:?}");
}

/// Of a photo that is not found, as many candidates are matched as the vote over the map may give.
#[test]
fn a_vote_over_the_map_gives_so_many_candidates() {
    const FEW: usize = 3;
    let (place, heading_deg) = PLACES[0];
    let photo = photo(&town(2), place, heading_deg);
    let matched = |candidates: usize| {
        let votes = MapVoteOptions {
            stage: 0,
            candidates,
            ..MapVoteOptions::default()
        };
        let options = Options {
            map_vote: Some(votes),
            ..Options::default()
        };
        let localizer = localizer_of(&scene().indexed_pack, options);
        let prior = Prior::none().with_gsd_m(PHOTO_GSD_M);
        let (outcome, trace) = localizer.locate_traced(&photo, &prior).unwrap();
        assert!(outcome.fix().is_none());
        trace.rounds[0].matched.len()
    };
    assert!(matched(FEW) <= FEW);
    assert!(matched(MapVoteOptions::default().candidates) > FEW);
}

/// Without any tile found by descriptor, the votes of local descriptors over the whole map find the right one.
#[test]
fn a_place_is_found_by_votes_over_the_map() {
    let options = |map_vote| Options {
        top_k: 1,
        stages: vec![1],
        map_vote,
        ..Options::default()
    };
    let votes = MapVoteOptions {
        stage: 0,
        places: 3,
        ..MapVoteOptions::default()
    };
    let with = localizer_of(&scene().indexed_pack, options(Some(votes)));
    let without = localizer_of(&scene().indexed_pack, options(None));
    let covers = |tiles: &[usize], place: MapPx| {
        let level = &with.pack().levels()[0];
        let truth = level.level_px_from_map_px(place);
        tiles.iter().position(|&tile| {
            let centre = level.tile(tile).centre_px;
            let half = f64::from(level.tile_px()) / 2.0;
            (centre.x - truth.x).abs() <= half && (centre.y - truth.y).abs() <= half
        })
    };
    for (place, heading_deg) in PLACES {
        let photo = photo(&scene().picture, place, heading_deg);
        let prior = Prior::none().with_gsd_m(PHOTO_GSD_M);
        let (outcome, trace) = with.locate_traced(&photo, &prior).unwrap();
        assert!(error_m(&outcome, place) < 2.0);
        assert_eq!(covers(&trace.rounds[0].by_search, place), Some(0));
        let (_, trace) = without.locate_traced(&photo, &prior).unwrap();
        assert_eq!(trace.rounds[0].by_search, trace.rounds[0].by_descriptor);
        // The votes stay within a given area.
        let elsewhere = MapPx::new(1500.0 - place.x, 1300.0 - place.y);
        let (_, trace) = with
            .locate_traced(&photo, &prior.near(truth(elsewhere), 20.0))
            .unwrap();
        let level = &with.pack().levels()[0];
        for &tile in &trace.rounds[0].by_search {
            let centre = level
                .lonlat_from_level_px(level.tile(tile).centre_px)
                .unwrap();
            assert!(distance_m(centre, truth(elsewhere)) < 20.0 + level.tile_m());
        }
    }
}
