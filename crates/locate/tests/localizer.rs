//! The facade from end to end: a made-up map, its pack, and photos of it.

#![allow(clippy::unwrap_used)]

use std::{path::PathBuf, sync::OnceLock};

use grimnet_geo::{LonLat, MapOptions, MapPx, Raster, distance_m, open_map};
use grimnet_locate::{
    Adapt, Coordinates, Localizer, LocateError, Options, Outcome, Prior, Reason, TimeMs,
    draw::{DrawOptions, draw},
    internals::ransac::Ransac,
};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Levels, Pack, build};
use grimnet_photo::{Metadata, Photo};
use image::{Rgb, RgbImage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const MAP_PX: (u32, u32) = (1500, 1300);
const GSD_M: f64 = 0.3;
const PHOTO_PX: (u32, u32) = (640, 400);
/// Ground metres per photo pixel.
const PHOTO_GSD_M: f64 = 0.24;

/// Roofs, roads and fields without order: every place looks different.
fn town(seed: u64) -> RgbImage {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut map = RgbImage::from_pixel(MAP_PX.0, MAP_PX.1, Rgb([96, 110, 84]));
    for _ in 0..2600 {
        let (x, y) = (rng.random_range(0..MAP_PX.0), rng.random_range(0..MAP_PX.1));
        let (w, h) = (rng.random_range(6..60u32), rng.random_range(6..60u32));
        let turn: f32 = rng.random_range(0.0..1.5);
        let colour = Rgb(std::array::from_fn(|_| rng.random_range(40..230u8)));
        let (sin, cos) = turn.sin_cos();
        let reach = w + h;
        for v in y.saturating_sub(reach)..(y + reach).min(MAP_PX.1) {
            for u in x.saturating_sub(reach)..(x + reach).min(MAP_PX.0) {
                let (dx, dy) = (u as f32 - x as f32, v as f32 - y as f32);
                let (a, b) = (dx * cos + dy * sin, dy * cos - dx * sin);
                if a.abs() < w as f32 / 2.0 && b.abs() < h as f32 / 2.0 {
                    map.put_pixel(u, v, colour);
                }
            }
        }
    }
    map
}

/// A photo of `map` around a map pixel, straight down, its top at `heading_deg` (the map is north-up), a little darker.
fn photo(map: &RgbImage, centre: MapPx, heading_deg: f64) -> Photo {
    photo_of(map, centre, heading_deg, PHOTO_PX, PHOTO_GSD_M / GSD_M)
}

/// The same with `size_px` and `scale` map pixels per photo pixel.
fn photo_of(
    map: &RgbImage,
    centre: MapPx,
    heading_deg: f64,
    size_px: (u32, u32),
    scale: f64,
) -> Photo {
    let (sin, cos) = heading_deg.to_radians().sin_cos();
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let image = RgbImage::from_fn(size_px.0, size_px.1, |x, y| {
        let (dx, dy) = (
            (f64::from(x) + 0.5 - f64::from(size_px.0) / 2.0) * scale,
            (f64::from(y) + 0.5 - f64::from(size_px.1) / 2.0) * scale,
        );
        let (u, v) = (
            centre.x + dx * cos - dy * sin - 0.5,
            centre.y + dx * sin + dy * cos - 0.5,
        );
        let sample = |u: f64, v: f64, channel: usize| {
            let inside = |along: f64, side: u32| along.clamp(0.0, f64::from(side - 1)) as u32;
            f64::from(map.get_pixel(inside(u, MAP_PX.0), inside(v, MAP_PX.1))[channel])
        };
        let (fu, fv) = (u - u.floor(), v - v.floor());
        let noise = rng.random_range(-6.0..6.0);
        Rgb(std::array::from_fn(|channel| {
            let top = sample(u.floor(), v.floor(), channel) * (1.0 - fu)
                + sample(u.floor() + 1.0, v.floor(), channel) * fu;
            let bottom = sample(u.floor(), v.floor() + 1.0, channel) * (1.0 - fu)
                + sample(u.floor() + 1.0, v.floor() + 1.0, channel) * fu;
            ((top * (1.0 - fv) + bottom * fv) * 0.8 + 12.0 + noise).clamp(0.0, 255.0) as u8
        }))
    });
    Photo::from_image(image, Metadata::default())
}

struct Scene {
    picture: RgbImage,
    map: Box<dyn Raster>,
    default_pack: PathBuf,
    paper_pack: PathBuf,
    _folder: tempfile::TempDir,
}

fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let picture = town(1);
        let path = folder.path().join("town.png");
        picture.save(&path).unwrap();
        let world = format!(
            "{GSD_M}\n0\n0\n-{GSD_M}\n{}\n{}\n",
            500_000.0 + GSD_M / 2.0,
            5_400_000.0 - GSD_M / 2.0
        );
        std::fs::write(folder.path().join("town.pgw"), world).unwrap();
        let options = MapOptions {
            crs: Some("EPSG:32633".into()),
            ..MapOptions::default()
        };
        let map = open_map(&path, &options).unwrap();
        let build_pack = |name: &str, options: &BuildOptions| {
            let out = folder.path().join(name);
            build(
                map.as_ref(),
                &Model::bundled().unwrap(),
                options,
                &out,
                &mut |_| (),
            )
            .unwrap();
            out
        };
        let default_pack = build_pack(
            "default.grim",
            &BuildOptions {
                levels: Levels::Gsd(vec![0.3, 0.6]),
                ..BuildOptions::standard()
            },
        );
        let paper_pack = build_pack("paper.grim", &BuildOptions::paper());
        Scene {
            picture,
            map,
            default_pack,
            paper_pack,
            _folder: folder,
        }
    })
}

fn localizer(options: Options) -> Localizer {
    let pack = Pack::open(&scene().default_pack).unwrap();
    Localizer::new(Model::bundled().unwrap(), pack)
        .unwrap()
        .with_options(options)
}

fn truth(place: MapPx) -> LonLat {
    scene()
        .map
        .georeference()
        .lonlat_from_map_px(place)
        .unwrap()
}

fn error_m(outcome: &Outcome, place: MapPx) -> f64 {
    match outcome {
        Outcome::Fix(fix) => distance_m(LonLat::new(fix.lon_deg, fix.lat_deg), truth(place)),
        Outcome::NoFix(reason) => panic!("no fix: {reason}"),
    }
}

/// Without what differs from run to run.
fn timeless(mut outcome: Outcome) -> Outcome {
    match &mut outcome {
        Outcome::Fix(fix) => fix.time_ms = TimeMs::default(),
        Outcome::NoFix(no_fix) => no_fix.time_ms = TimeMs::default(),
    }
    outcome
}

const PLACES: [(MapPx, f64); 3] = [
    (MapPx::new(430.0, 520.0), 37.0),
    (MapPx::new(1010.5, 760.25), 214.0),
    (MapPx::new(760.0, 380.0), 300.0),
];

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
        let north_deg = scene().map.georeference().up_bearing_deg(place).unwrap();
        let prior = Prior::none()
            .with_gsd_m(PHOTO_GSD_M)
            .with_heading(heading_deg + north_deg, 3.0);
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
        // On a UTM map off its central meridian grid north is not true north.
        let north_deg = scene().map.georeference().up_bearing_deg(place).unwrap();
        let prior = Prior::none()
            .with_gsd_m(PHOTO_GSD_M)
            .with_heading(heading_deg + north_deg + 3.0, 3.0);
        let outcome = localizer.locate(&photo, &prior).unwrap();
        let error_m = error_m(&outcome, place);
        let fix = outcome.fix().unwrap();
        assert!(error_m < 1.0, "{error_m} m");
        assert!(
            error_m <= fix.radius95_m && fix.radius95_m < 5.0,
            "{error_m} m, stated {}",
            fix.radius95_m
        );
        let turn_deg =
            (fix.heading_deg.unwrap() - heading_deg - north_deg + 540.0).rem_euclid(360.0) - 180.0;
        assert!(turn_deg.abs() < 1.0, "{turn_deg} degrees");
        assert!(
            (fix.gsd_m / PHOTO_GSD_M - 1.0).abs() < 0.01,
            "{}",
            fix.gsd_m
        );
        assert_eq!(fix.outline_lonlat_deg.len(), 4);
        let across =
            [0, 1].map(|i| LonLat::new(fix.outline_lonlat_deg[i][0], fix.outline_lonlat_deg[i][1]));
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
        let turn_deg = (outcome.fix().unwrap().heading_deg.unwrap() - heading_deg + 540.0)
            .rem_euclid(360.0)
            - 180.0;
        assert!(turn_deg.abs() < 3.0);
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
    let water = Photo::from_image(
        RgbImage::from_pixel(640, 400, Rgb([30, 60, 80])),
        Metadata::default(),
    );
    let Outcome::NoFix(no_fix) = localizer.locate(&water, &prior).unwrap() else {
        panic!("water was found")
    };
    assert!(
        matches!(
            no_fix.reason,
            Reason::TooFewKeypoints { .. } | Reason::Rejected(_)
        ),
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
    assert!(beside.fix().is_none());
    let far = localizer
        .locate(&photo, &prior.near(LonLat::new(0.0, 0.0), 1000.0))
        .unwrap();
    let Outcome::NoFix(no_fix) = far else {
        panic!("found far away")
    };
    assert_eq!(no_fix.reason, Reason::NoTiles);
}

#[test]
fn answers_are_the_same_on_any_number_of_threads() {
    let localizer = localizer(Options {
        keep_matches: true,
        ..Options::default()
    });
    let prior = Prior::none().with_gsd_m(PHOTO_GSD_M);
    let photos = [
        photo(&scene().picture, PLACES[2].0, PLACES[2].1),
        photo(&town(2), PLACES[0].0, 10.0),
    ];
    let mut answers = Vec::new();
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let all: Vec<Outcome> = pool.install(|| {
            photos
                .iter()
                .map(|photo| timeless(localizer.locate(photo, &prior).unwrap()))
                .collect()
        });
        answers.push(all);
    }
    assert_eq!(answers[0], answers[1]);
    assert_eq!(answers[0], answers[2]);
}

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
        // No tile's centre is near, so only the homography and the equations 22 and 23 can lead there.
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
        let north_deg = scene().map.georeference().up_bearing_deg(centre).unwrap();
        let turn_deg =
            (fix.heading_deg.unwrap() - heading_deg - north_deg + 540.0).rem_euclid(360.0) - 180.0;
        assert!(turn_deg.abs() < 1.5, "{turn_deg} degrees");
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

    let refused =
        self::localizer(Options::paper()).locate(&photo(&town(2), place, 0.0), &Prior::none());
    assert!(matches!(refused, Err(LocateError::NotAPaperPack { .. })));
}

#[test]
fn invalid_settings_priors_and_packs_are_errors() {
    let photo = photo(&scene().picture, PLACES[0].0, 0.0);
    let base = Options::default();
    for options in [
        Options {
            top_k: 0,
            ..base.clone()
        },
        Options {
            max_matched: 0,
            ..base.clone()
        },
        Options {
            query_width_px: f64::NAN,
            ..base.clone()
        },
        Options {
            hypothesis_side_px: 5,
            ..base.clone()
        },
    ] {
        assert!(matches!(
            localizer(options).locate(&photo, &Prior::none()),
            Err(LocateError::InvalidValue { .. })
        ));
    }
    let bad_place = Prior::none().near(LonLat::new(f64::NAN, 0.0), 10.0);
    assert!(localizer(base.clone()).locate(&photo, &bad_place).is_err());
    // Settings survive serialisation.
    let written = serde_json::to_string(&Options::paper()).unwrap();
    assert_eq!(
        serde_json::from_str::<Options>(&written).unwrap(),
        Options::paper()
    );
    // A pack built with another model is refused.
    let other = Model::random(Model::bundled().unwrap().spec(), 3).unwrap();
    let pack = Pack::open(&scene().default_pack).unwrap();
    assert!(matches!(
        Localizer::new(other, pack),
        Err(LocateError::Pack(_))
    ));
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
    assert!(localizer(Options::default()).adapted_to_flight([]).is_err());
}

#[test]
fn the_builder_opens_packs_and_checks_settings() {
    let path = &scene().default_pack;
    let (place, heading_deg) = PLACES[0];
    let photo = photo(&scene().picture, place, heading_deg);
    let prior = Prior::none()
        .with_gsd_m(PHOTO_GSD_M)
        .with_heading(heading_deg, 3.0);
    let plain = timeless(
        Localizer::open(path)
            .unwrap()
            .locate(&photo, &prior)
            .unwrap(),
    );
    assert!(error_m(&plain, place) < 2.0);
    let built = Localizer::builder()
        .model(Model::bundled().unwrap())
        .options(Options {
            map_error_m: 3.0,
            ..Options::default()
        })
        .open(path)
        .unwrap();
    let built = built.locate(&photo, &prior).unwrap();
    let radii = [&plain, &built].map(|outcome| outcome.fix().unwrap().radius95_m);
    assert!(radii[1] > 6.0 && radii[1] > radii[0], "{radii:?}");
    let invalid = Localizer::builder()
        .options(Options {
            unknown_scales: Vec::new(),
            ..Options::default()
        })
        .open(path);
    assert!(matches!(
        invalid,
        Err(LocateError::InvalidValue {
            field: "unknown_scales",
            ..
        })
    ));
    assert!(matches!(
        Localizer::open(path.with_file_name("absent.grim")),
        Err(LocateError::Pack(_))
    ));
}
