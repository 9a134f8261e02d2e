//! The facade from end to end: a made-up map, its pack, and photos of it.

#![allow(clippy::unwrap_used)]

mod default_mode;
mod paper_mode;
use std::{
    path::{Path, PathBuf},
    sync::OnceLock,
};

use grimnet_geo::{LonLat, MapOptions, MapPx, Raster, distance_m, open_map, turn_deg};
use grimnet_locate::{
    Adapt, Coordinates, Localizer, LocateError, MapVoteOptions, Options, Outcome, Prior, Reason,
    Rejection, TimeMs,
    draw::{DrawOptions, draw},
    internals::ransac::Ransac,
};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Levels, Pack, build};
use grimnet_photo::{ImageDirection, Metadata, Photo};
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
    indexed_pack: PathBuf,
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
        let two_levels = BuildOptions {
            levels: Levels::Gsd(vec![0.3, 0.6]),
            ..BuildOptions::standard()
        };
        let default_pack = build_pack("default.grim", &two_levels);
        let indexed_pack = build_pack(
            "indexed.grim",
            &BuildOptions {
                keypoint_index_tiles: 1,
                ..two_levels
            },
        );
        let paper_pack = build_pack("paper.grim", &BuildOptions::paper());
        Scene {
            picture,
            map,
            default_pack,
            paper_pack,
            indexed_pack,
            _folder: folder,
        }
    })
}

fn localizer(options: Options) -> Localizer {
    localizer_of(&scene().default_pack, options)
}

fn localizer_of(pack: &Path, options: Options) -> Localizer {
    let pack = Pack::open(pack).unwrap();
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

/// Direction of the map's up at a place: on a UTM map off its central meridian grid north is not true north.
fn north_deg(place: MapPx) -> f64 {
    scene().map.georeference().up_bearing_deg(place).unwrap()
}

/// Heading, clockwise from the map's up, and scale of a photo of [`photo`] are known.
fn known_view(place: MapPx, heading_deg: f64) -> Prior {
    Prior::none()
        .with_gsd_m(PHOTO_GSD_M)
        .with_heading(heading_deg + north_deg(place), 3.0)
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
