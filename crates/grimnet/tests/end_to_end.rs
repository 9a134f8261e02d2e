//! The library as a user has it: a procedural map and photos as files, a pack, fixes and errors.

#![allow(clippy::unwrap_used)]

use std::{path::Path, sync::OnceLock};

use grimnet::{
    Localizer, LocateError, LonLat, Model, Options, Outcome, Pack, Photo, PhotoError, PhotoLimits,
    Prior, Reason,
    map::{self, BuildError, BuildOptions, Levels, MapBuild},
};
use grimnet_geo::turn_deg;
use grimnet_world::{
    Camera, Look, PhotoTags, Placement, Pose, RegionM, Season, World, WorldConfig, write_geotiff,
    write_jpeg_with_exif,
};
use image::{Rgb, RgbImage};

const SIZE_M: f64 = 420.0;
const MAP_GSD_M: f64 = 0.3;
/// 126 m wide on the ground from 90 m: more than a tile of the finest level.
const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 800,
    height_px: 600,
};
const POSES: [Pose; 2] = [
    Pose {
        x_m: 180.0,
        y_m: 230.0,
        height_agl_m: 90.0,
        heading_deg: 40.0,
        pitch_off_nadir_deg: 0.0,
        roll_deg: 0.0,
    },
    Pose {
        x_m: 255.0,
        y_m: 170.0,
        height_agl_m: 95.0,
        heading_deg: 215.0,
        pitch_off_nadir_deg: 0.0,
        roll_deg: 0.0,
    },
];

struct Area {
    folder: tempfile::TempDir,
    placement: Placement,
}

impl Area {
    fn file(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join(name)
    }

    fn photo(&self, index: usize) -> Photo {
        Photo::open(self.file(&format!("photo_{index}.jpg"))).unwrap()
    }

    /// Distance between a fix and the true position of a photo's centre, metres.
    fn error_m(&self, outcome: &Outcome, index: usize) -> f64 {
        let Outcome::Fix(fix) = outcome else {
            panic!("no fix: {outcome:?}")
        };
        let [lon_deg, lat_deg] = self
            .placement
            .lonlat_from_world([POSES[index].x_m, POSES[index].y_m])
            .unwrap();
        let (north_deg, east_deg) = (fix.lat_deg - lat_deg, fix.lon_deg - lon_deg);
        // Metres per degree near the equator, to a few parts in a thousand.
        (north_deg * 110_600.0).hypot(east_deg * 111_320.0 * lat_deg.to_radians().cos())
    }
}

/// A camera's frame comes without a file: what is known of it is put together here, and what an answer says is passed on.
#[test]
fn fields_of_metadata_and_answers_have_types_that_can_be_named() {
    let metadata = grimnet::Metadata {
        position: Some(grimnet::GpsPosition {
            lat_deg: 1.0,
            lon_deg: 2.0,
        }),
        image_direction: Some(grimnet::ImageDirection {
            bearing_deg: 40.0,
            magnetic: false,
        }),
        ..grimnet::Metadata::default()
    };
    let _: (Option<grimnet::ExposureTime>, Vec<grimnet::Evidence>) =
        (metadata.exposure_time, metadata.notes);
    let _: fn(&grimnet::MatchedPair) -> (grimnet::PhotoPx, grimnet::MapPx) =
        |pair| (pair.photo_px, pair.map_px);
    let _: fn(&grimnet::MatchedPoints) -> grimnet::WindowPx = |points| points.tile_map_px;
    let _: fn(&Photo) -> grimnet::View = |photo| photo.view(&grimnet::ViewPrior::default());
    let _: fn(&grimnet::View) -> Option<grimnet::Footprint> = |view| view.footprint;
    let _: (grimnet::QueryOptions, Option<grimnet::Tilt>) =
        (grimnet::QueryOptions::new(0.3, 150.0), None);
    let _: fn(&Pack) -> (grimnet::PackInfo, &[grimnet::Level]) =
        |pack| (pack.info(), pack.levels());
    let missing = Pack::open_with("nowhere.grim", &grimnet::PackLimits::default());
    assert!(missing.is_err());
}

fn small_pack() -> MapBuild {
    MapBuild {
        pack: BuildOptions {
            levels: Levels::Gsd(vec![MAP_GSD_M]),
            ..BuildOptions::default()
        },
        ..MapBuild::default()
    }
}

/// Map, photos and pack, made once.
fn area() -> &'static Area {
    static AREA: OnceLock<Area> = OnceLock::new();
    AREA.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let placement = Placement::at(1.5, 1.0).unwrap();
        let world = World::new(WorldConfig {
            seed: 11,
            size_m: SIZE_M,
            ..WorldConfig::default()
        });
        let whole = RegionM {
            x_min_m: 0.0,
            y_min_m: 0.0,
            width_m: SIZE_M,
            height_m: SIZE_M,
        };
        let map = world.render_map(whole, MAP_GSD_M, &Look::satellite(Season::Summer));
        write_geotiff(
            &folder.path().join("map.tif"),
            &map,
            MAP_GSD_M,
            placement.utm_from_world([0.0, SIZE_M]),
            placement.epsg(),
        )
        .unwrap();
        for (index, pose) in POSES.iter().enumerate() {
            let photo = world.render_photo(pose, &CAMERA, &Look::drone(Season::Summer));
            let tags = PhotoTags::for_pose(pose, &CAMERA, &placement, 40.0).unwrap();
            let path = folder.path().join(format!("photo_{index}.jpg"));
            write_jpeg_with_exif(&path, &photo, 92, &tags).unwrap();
        }
        let area = Area { folder, placement };
        let mut calls = 0;
        let report = map::build(
            area.file("map.tif"),
            area.file("area.grim"),
            &small_pack(),
            |_| calls += 1,
        )
        .unwrap();
        assert!(report.tiles > 0 && calls > 0);
        area
    })
}

#[test]
fn photos_are_localised_from_their_metadata_and_without_a_heading() {
    let area = area();
    let localizer = Localizer::open(area.file("area.grim")).unwrap();
    for (index, pose) in POSES.iter().enumerate() {
        let photo = area.photo(index);
        for prior in [Prior::none(), Prior::none().with_unknown_heading()] {
            let outcome = localizer.locate(&photo, &prior).unwrap();
            let error_m = area.error_m(&outcome, index);
            assert!(error_m < 5.0, "photo {index}: {error_m} m");
            let fix = outcome.fix().unwrap();
            let off_deg = turn_deg(pose.heading_deg, fix.heading_deg.unwrap());
            assert!(off_deg.abs() < 4.0, "photo {index}: {off_deg} degrees");
            assert!(fix.radius95_m > 0.0 && fix.radius95_m < 20.0);
        }
    }
}

#[test]
fn large_photos_are_read_at_the_size_that_the_map_needs() {
    let area = area();
    let localizer = Localizer::open(area.file("area.grim")).unwrap();
    let camera = Camera {
        width_px: 2600,
        height_px: 1950,
        ..CAMERA
    };
    let world = World::new(WorldConfig {
        seed: 11,
        size_m: SIZE_M,
        ..WorldConfig::default()
    });
    let picture = world.render_photo(&POSES[0], &camera, &Look::drone(Season::Summer));
    let tags = PhotoTags::for_pose(&POSES[0], &camera, &area.placement, 40.0).unwrap();
    let path = area.file("large.jpg");
    write_jpeg_with_exif(&path, &picture, 92, &tags).unwrap();
    let needed = localizer.needed_pixels(&Prior::none());
    let photo = needed.open(&path, &PhotoLimits::DEFAULT).unwrap();
    assert_eq!(photo.full_size_px, (2600, 1950));
    assert_eq!(photo.image.dimensions(), (1300, 975));
    let outcome = localizer.locate(&photo, &Prior::none()).unwrap();
    let error_m = area.error_m(&outcome, 0);
    assert!(error_m < 3.0, "{error_m} m");
    // Four times the footprint does not suit the map's only level, so that more pixels are needed.
    let wide = Prior::none().with_gsd_m(4.0 * 126.0 / 2600.0);
    let photo = localizer
        .needed_pixels(&wide)
        .open(&path, &PhotoLimits::DEFAULT);
    assert_eq!(photo.unwrap().image.dimensions(), (2048, 1536));
}

#[test]
fn a_finished_pack_is_kept_and_a_builder_changes_settings() {
    let area = area();
    let pack = area.file("area.grim");
    let again = map::build(area.file("map.tif"), &pack, &small_pack(), |_| ()).unwrap();
    assert!(again.was_complete);
    let with_map_error = |map_error_m| {
        Localizer::builder()
            .model(Model::bundled().unwrap())
            .options(Options {
                map_error_m,
                ..Options::default()
            })
            .build(Pack::open(&pack).unwrap())
            .unwrap()
            .locate(&area.photo(0), &Prior::none())
            .unwrap()
            .fix()
            .unwrap()
            .radius95_m
    };
    // Of a circular normal distribution 95 % lie within 2.45 sigma.
    assert!(with_map_error(5.0) > 2.44 * 5.0 && with_map_error(0.0) < 5.0);
}

#[test]
fn only_packs_are_replaced() {
    let area = area();
    let map = area.file("map.tif");
    let notes = area.file("notes.txt");
    std::fs::write(&notes, "mine").unwrap();
    let mut build = small_pack();
    let error = map::build(&map, &notes, &build, |_| ()).unwrap_err();
    assert!(matches!(error, BuildError::Output(_)), "{error:?}");
    assert!(error.to_string().contains("notes.txt"), "{error}");
    assert_eq!(std::fs::read_to_string(&notes).unwrap(), "mine");

    // A pack, though a damaged one.
    let damaged = area.file("damaged.grim");
    let pack = std::fs::read(area.file("area.grim")).unwrap();
    std::fs::write(&damaged, &pack[..pack.len() / 2]).unwrap();
    map::build(&map, &damaged, &build, |_| ()).unwrap();
    assert_eq!(std::fs::read(&damaged).unwrap(), pack);

    build.overwrite = true;
    let size_bytes = std::fs::metadata(&map).unwrap().len();
    let error = map::build(&map, &map, &build, |_| ()).unwrap_err();
    assert!(matches!(error, BuildError::Output(_)), "{error:?}");
    assert_eq!(std::fs::metadata(&map).unwrap().len(), size_bytes);
    map::build(&map, &notes, &build, |_| ()).unwrap();
    assert_eq!(std::fs::read(&notes).unwrap(), pack);
}

#[test]
fn no_fix_has_a_reason() {
    let area = area();
    let localizer = Localizer::open(area.file("area.grim")).unwrap();
    let far = Prior::none().near(LonLat::new(20.0, 50.0), 1000.0);
    let outcome = localizer.locate(&area.photo(0), &far).unwrap();
    let Outcome::NoFix(no_fix) = &outcome else {
        panic!("{outcome:?}")
    };
    assert_eq!(no_fix.reason, Reason::NoTiles);
    assert_eq!(no_fix.to_string(), "the pack has no tile in the given area");

    let water = area.file("water.png");
    RgbImage::from_pixel(640, 480, Rgb([30, 60, 80]))
        .save(&water)
        .unwrap();
    let prior = Prior::none().with_gsd_m(0.2);
    let outcome = localizer
        .locate(&Photo::open(&water).unwrap(), &prior)
        .unwrap();
    assert!(outcome.fix().is_none());
}

#[test]
fn errors_name_what_is_wrong() {
    let area = area();
    let pack = area.file("area.grim");
    let absent = area.file("absent.jpg");
    let error = Photo::open(&absent).unwrap_err();
    assert!(matches!(error, PhotoError::Read { .. }));
    assert!(error.to_string().contains("absent.jpg"), "{error}");

    let not_a_pack = area.file("map.tif");
    let error = Localizer::open(&not_a_pack).unwrap_err();
    assert!(matches!(error, LocateError::Pack(_)));
    assert!(error.to_string().contains("map.tif"), "{error}");

    let error = map::build(&absent, area.file("x.grim"), &MapBuild::default(), |_| ());
    assert!(matches!(error, Err(BuildError::Map(_))), "{error:?}");
    assert!(!Path::new(&area.file("x.grim")).exists());

    let spec = Model::bundled().unwrap();
    let other = Model::random(spec.spec(), 3).unwrap();
    let error = Localizer::builder().model(other).open(&pack).unwrap_err();
    assert!(matches!(error, LocateError::Pack(_)), "{error}");

    let options = Options {
        map_error_m: f64::NAN,
        ..Options::default()
    };
    let error = Localizer::builder()
        .options(options)
        .open(&pack)
        .unwrap_err();
    let text = "map_error_m is NaN; expected 0 to 100000 metres";
    assert_eq!(error.to_string(), text);

    let localizer = Localizer::open(&pack).unwrap();
    let prior = Prior::none().with_height_agl_m(-3.0);
    let error = localizer.locate(&area.photo(0), &prior).unwrap_err();
    let text = "height_agl_m is -3; expected 2 to 20000 metres";
    assert_eq!(error.to_string(), text);
}
