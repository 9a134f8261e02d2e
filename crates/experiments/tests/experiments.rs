//! Experiments from end to end, on one small procedural world.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Arc;

use grimnet_eval::datasets::{DataSet, DataSetRequest};
use grimnet_eval::scene::{HeadingMode, PhotoSource, Scene, Shot, Truth};
use grimnet_experiments::bench::{Bench, Localisation, Setup};
use grimnet_experiments::experiment::Experiment;
use grimnet_experiments::given::Given;
use grimnet_experiments::photometry::Photometry;
use grimnet_experiments::recipe::Variant;
use grimnet_experiments::tables;
use grimnet_experiments::world_flight::WorldFlight;
use grimnet_geo::{LonLat, MapOptions, WindowPx, distance_m};
use grimnet_locate::Prior;
use grimnet_net::Model;
use grimnet_output::{OutputFolder, OutputPolicy};
use grimnet_photo::{Metadata, Photo, PhotoLimits};

/// A photo cut out of the map, so that any matcher must find it to a fraction of a pixel.
fn cut(scene: &Scene, [x, y]: [f64; 2], [w, h]: [f64; 2]) -> Shot {
    let patch = scene
        .map
        .read(WindowPx::new(x, y, w, h), w as u32, h as u32)
        .unwrap();
    let georeference = scene.map.georeference();
    let centre = grimnet_geo::MapPx::new(x + w / 2.0, y + h / 2.0);
    let metadata = Metadata {
        orientation: 1,
        ..Metadata::default()
    };
    Shot {
        name: "cut".into(),
        photo: PhotoSource::Memory(Arc::new(Photo::from_image(patch.rgb, metadata))),
        truth: Truth::at(georeference.lonlat_from_map_px(centre).unwrap()),
        known: Prior::none()
            .with_heading(georeference.up_bearing_deg(centre).unwrap(), 5.0)
            .with_gsd_m(georeference.ground_resolution_m(centre).unwrap().0),
        footprint_width_m: None,
    }
}

#[test]
fn every_method_finds_a_piece_of_the_map_and_darkness_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = WorldFlight::over("town", 5, 320.0, 0.9, 1)
        .make(folder.path())
        .unwrap();
    let shot = cut(&scene, [400.0, 380.0], [384.0, 288.0]);
    scene.shots = vec![shot];
    let model = Model::bundled().unwrap();
    let mut bench = Bench::new(&model, folder.path()).unwrap();
    for method in [
        Localisation::Learned,
        Localisation::SiftWholeMap,
        Localisation::SiftAmongRetrieved,
    ] {
        let setup = Setup {
            method,
            ..Variant::DEFAULT_WITH_PRIOR.setup(&scene).unwrap()
        };
        let measured = bench.measure(&scene, &setup).unwrap();
        let error_m = measured.frames[0].error_m.unwrap();
        assert!(error_m < 0.5, "{method:?}: {error_m} m");
        assert_eq!(
            measured.covers.len(),
            usize::from(method == Localisation::Learned)
        );
    }
    let dark = Setup {
        photometry: Photometry::Brightness(0.0),
        ..Variant::DEFAULT_WITH_PRIOR.setup(&scene).unwrap()
    };
    assert!(!bench.measure(&scene, &dark).unwrap().frames[0].fixed);
}

/// In the paper's procedure SIFT takes the place of keypoints and descriptors alone: it always answers, by the homography of the tile
/// that wins, or with the centre of the most similar tile.
#[test]
fn sift_in_the_papers_procedure_answers_by_its_homography_or_with_a_tile() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = WorldFlight::over("town", 5, 400.0, 0.5, 1)
        .make(folder.path())
        .unwrap();
    let flat = Photo::from_image(
        image::RgbImage::from_pixel(512, 512, image::Rgb([90, 110, 70])),
        Metadata::default(),
    );
    let found = cut(&scene, [120.0, 90.0], [512.0, 512.0]);
    scene.shots = vec![
        found.clone(),
        Shot {
            photo: PhotoSource::Memory(Arc::new(flat)),
            ..found
        },
    ];
    let model = Model::bundled().unwrap();
    let mut bench = Bench::new(&model, folder.path()).unwrap();
    let setup = Setup {
        method: Localisation::SiftAmongRetrieved,
        ..Variant::PAPER.setup(&scene).unwrap()
    };
    let frames = bench.measure(&scene, &setup).unwrap().frames;
    let error_m = frames[0].error_m.unwrap();
    assert!(error_m < 0.5, "{error_m} m, no tile has this centre");
    let error_m = frames[1].error_m.unwrap();
    assert!(error_m > 5.0, "{error_m} m: the centre of some tile");
}

/// With its ground width given, a photo twice as wide as a tile of the finest level is compared with the next level; SIFT features of the finest
/// level, made before for photos of unknown scale, are not those.
#[test]
fn sift_is_compared_with_the_level_of_each_photo() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = WorldFlight::over("town", 5, 320.0, 0.9, 1)
        .make(folder.path())
        .unwrap();
    scene.shots = vec![cut(&scene, [120.0, 150.0], [800.0, 600.0])];
    let model = Model::bundled().unwrap();
    let mut bench = Bench::new(&model, folder.path()).unwrap();
    let mut error_m = |variant: Variant, method: Localisation| {
        let setup = Setup {
            method,
            ..variant.setup(&scene).unwrap()
        };
        bench.measure(&scene, &setup).unwrap().frames[0].error_m
    };
    error_m(Variant::DEFAULT_WITHOUT_PRIOR, Localisation::SiftWholeMap);
    for method in [Localisation::SiftAmongRetrieved, Localisation::SiftWholeMap] {
        let error_m = error_m(Variant::DEFAULT_WITH_PRIOR, method).unwrap();
        assert!(error_m < 1.0, "{method:?}: {error_m} m");
    }
}

#[test]
fn a_table_has_a_column_a_scene_and_what_an_average_hides() {
    let folder = tempfile::tempdir().unwrap();
    let scene = WorldFlight::over("hamlet", 6, 320.0, 0.7, 2)
        .make(folder.path())
        .unwrap();
    assert!(distance_m(scene.shots[0].truth.position, scene.shots[1].truth.position) > 1.0);
    let model = Model::bundled().unwrap();
    let mut bench = Bench::new(&model, folder.path()).unwrap();
    let scenes = [scene];
    let table = tables::run(Experiment::Photometry, &mut bench, &scenes).unwrap();
    // Four conditions by the paper's procedure and by the default method, with nothing given and with heading and scale.
    assert_eq!((table.paper_table, table.rows.len()), (Some(7), 16));
    assert_eq!(
        table.rows[0].name,
        "Original condition, paper's procedure, compact network"
    );
    let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "hamlet",
            "average",
            "with a fix",
            "within 20 m",
            "time per frame"
        ]
    );
    assert!(table.rows.iter().all(|row| row.values.len() == names.len()));
    assert_eq!(table.paper[0].values.len(), table.paper_columns.len());

    // Figure 7b has the frames of every method, figure 7a of each row.
    let table = tables::run(Experiment::Success, &mut bench, &scenes).unwrap();
    assert_eq!((table.rows.len(), table.figures.len()), (6, 6));
    let out = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    table.write(&out).unwrap();
    let svg = std::fs::read_to_string(folder.path().join(&table.figures[0].file)).unwrap();
    assert!(svg.contains("<svg"));
}

/// The paper's procedure finds a piece of the map as large as a tile whichever way it is turned only if the heading is given, and a
/// smaller one only if the map is resampled to its footprint.
#[test]
fn what_is_given_reaches_the_method() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = WorldFlight::over("town", 5, 320.0, 0.9, 1)
        .make(folder.path())
        .unwrap();
    // A square photo, which paper mode does not distort.
    let mut shot = cut(&scene, [400.0, 380.0], [400.0, 400.0]);
    let upright = shot.photo.open().unwrap();
    let turned = image::imageops::rotate90(&upright.image);
    let up = scene.map.georeference();
    let up_deg = up.up_bearing_deg(up.centre_px()).unwrap();
    // Turned clockwise, the photo's top is the map's left.
    shot.photo = PhotoSource::Memory(Arc::new(Photo::from_image(
        turned,
        upright.metadata.clone(),
    )));
    shot.known = shot.known.with_heading(up_deg + 270.0, 5.0);
    scene.shots = vec![shot];
    let model = Model::bundled().unwrap();
    let mut bench = Bench::new(&model, folder.path()).unwrap();
    let mut error_m = |variant: Variant| {
        let setup = variant.setup(&scene).unwrap();
        bench.measure(&scene, &setup).unwrap().frames[0].error_m
    };
    assert!(error_m(Variant::PAPER_WITH_PRIOR).unwrap() < 3.0);
    assert!(error_m(Variant::PAPER).is_none_or(|m| m > 5.0));
    let heading_withheld = Variant {
        given: Given::Scale,
        ..Variant::PAPER_WITH_PRIOR
    };
    assert!(error_m(heading_withheld).is_none_or(|m| m > 5.0));
    assert!(error_m(Variant::DEFAULT_WITH_PRIOR).unwrap() < 1.0);
}

#[test]
fn photos_are_read_with_their_truth_and_scale() {
    let folder = tempfile::tempdir().unwrap();
    let flown = WorldFlight::over("town", 5, 320.0, 0.9, 1)
        .make(folder.path())
        .unwrap();
    let data = folder.path().join("data");
    std::fs::create_dir_all(data.join("photos")).unwrap();
    std::fs::copy(folder.path().join("town.tif"), data.join("map.tif")).unwrap();
    let shot = &flown.shots[0];
    let photo = shot.photo.open().unwrap();
    photo.image.save(data.join("photos/a.jpg")).unwrap();
    let LonLat { lon_deg, lat_deg } = shot.truth.position;
    let truth = format!(
        "photo,lat_deg,lon_deg,heading_deg,footprint_w_m,place\na.jpg,{lat_deg},{lon_deg},30,160,square\ngone.jpg,1,1,,,\n"
    );
    std::fs::write(data.join("truth.csv"), truth).unwrap();
    let request = DataSetRequest {
        folder: &data,
        map: None,
        map_options: MapOptions::default(),
        scratch: folder.path(),
        photo_limits: PhotoLimits::DEFAULT,
    };
    let found = DataSet::find(&request).unwrap();
    let map = found.open_map().unwrap();
    let scene = found.into_scene(map).unwrap().decoded().unwrap();
    assert_eq!(scene.shots.len(), 1, "the other photo does not exist");
    let shot = &scene.shots[0];
    assert_eq!(shot.truth.place.as_deref(), Some("square"));
    let given = shot.prior(HeadingMode::Known, shot.photo.open().unwrap().full_size_px);
    assert_eq!(given.view.gsd_m, Some(0.2), "160 m over 800 px");
    assert_eq!(
        given.view.heading,
        Prior::none().with_heading(30.0, 5.0).view.heading
    );
    assert!((scene.ground_width_m().unwrap().unwrap() - 160.0).abs() < 1e-6);
    let elsewhere = format!("photo,lat_deg,lon_deg\na.jpg,{},{lon_deg}\n", lat_deg + 1.0);
    std::fs::write(data.join("truth.csv"), elsewhere).unwrap();
    let found = DataSet::find(&request).unwrap();
    let map = found.open_map().unwrap();
    let error = found.into_scene(map).err().unwrap().to_string();
    assert!(
        error.contains("none of the 1 true positions is on the map"),
        "{error}"
    );
}
