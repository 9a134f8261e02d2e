//! Experiments from end to end, on one small procedural world.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_eval::truth::TruthFrame;
use grimnet_experiments::bench::{Bench, Method, Setup};
use grimnet_experiments::photometry::Photometry;
use grimnet_experiments::scene::{Scene, Shot};
use grimnet_experiments::tables::{self, Experiment, Recipe};
use grimnet_experiments::world_flight::WorldFlight;
use grimnet_geo::{WindowPx, distance_m};
use grimnet_net::Model;
use grimnet_photo::{Metadata, Photo};

/// A photo cut out of the map, so that any matcher must find it to a fraction of a pixel.
fn cut(scene: &Scene) -> Shot {
    let (x, y, w, h) = (400.0, 380.0, 384.0, 288.0);
    let patch = scene
        .map
        .read(WindowPx::new(x, y, w, h), w as u32, h as u32)
        .unwrap();
    let georeference = scene.map.georeference();
    let centre = grimnet_geo::MapPx::new(x + w / 2.0, y + h / 2.0);
    Shot {
        name: "cut".into(),
        photo: Photo::from_image(
            patch.rgb,
            Metadata {
                orientation: 1,
                ..Metadata::default()
            },
        ),
        truth: georeference.lonlat_from_map_px(centre).unwrap(),
        heading_deg: Some(georeference.up_bearing_deg(centre).unwrap()),
        gsd_m: Some(georeference.ground_resolution_m(centre).unwrap().0),
    }
}

#[test]
fn every_method_finds_a_piece_of_the_map_and_darkness_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = WorldFlight::over("town", 5, 320.0, 0.9, 1)
        .make(folder.path())
        .unwrap();
    let shot = cut(&scene);
    scene.shots = vec![shot];
    let model = Model::bundled().unwrap();
    let mut bench = Bench::new(&model, folder.path()).unwrap();
    for method in [
        Method::Learned,
        Method::SiftWholeMap,
        Method::SiftAmongRetrieved,
    ] {
        let setup = Setup {
            method,
            ..Recipe::Default.setup()
        };
        let measured = bench.measure(&scene, &setup).unwrap();
        let error_m = measured.frames[0].error_m.unwrap();
        assert!(error_m < 0.5, "{method:?}: {error_m} m");
        assert_eq!(
            measured.covers.len(),
            usize::from(method == Method::Learned)
        );
    }
    let dark = Setup {
        photometry: Photometry::Brightness(0.0),
        ..Recipe::Default.setup()
    };
    assert!(!bench.measure(&scene, &dark).unwrap().frames[0].fixed);
}

#[test]
fn a_table_has_a_column_a_scene_and_what_an_average_hides() {
    let folder = tempfile::tempdir().unwrap();
    let scene = WorldFlight::over("hamlet", 6, 320.0, 0.7, 2)
        .make(folder.path())
        .unwrap();
    assert!(distance_m(scene.shots[0].truth, scene.shots[1].truth) > 1.0);
    let model = Model::bundled().unwrap();
    let mut bench = Bench::new(&model, folder.path()).unwrap();
    let table = tables::run(
        Experiment::Photometry,
        &mut bench,
        &[scene],
        Recipe::Default,
    )
    .unwrap();
    assert_eq!((table.paper_table, table.rows.len()), (Some(7), 4));
    let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "hamlet",
            "average",
            "with a fix",
            "within 20 m",
            "time a frame"
        ]
    );
    assert!(table.rows.iter().all(|row| row.values.len() == names.len()));
    assert_eq!(table.paper[0].values.len(), table.paper_columns.len());
}

#[test]
fn photos_are_read_with_their_truth_and_scale() {
    let folder = tempfile::tempdir().unwrap();
    let scene = WorldFlight::over("town", 5, 320.0, 0.9, 1)
        .make(folder.path())
        .unwrap();
    let path = folder.path().join("a.jpg");
    scene.shots[0].photo.image.save(&path).unwrap();
    let frame = |place| TruthFrame {
        photo: "a.jpg".into(),
        centre_lat_lon_deg: place,
        gps_lat_lon_deg: None,
        heading_deg: Some(30.0),
        height_agl_m: None,
    };
    let frames = vec![
        (frame(Some((1.0, 1.5))), path.clone()),
        (frame(None), path.clone()),
    ];
    let read = Scene::of("data", scene.map, frames, Some(160.0)).unwrap();
    assert_eq!(read.shots.len(), 1, "the other's place is not known");
    assert_eq!(read.shots[0].gsd_m, Some(0.2), "160 m over 800 px");
    assert!((read.ground_width_m().unwrap() - 160.0).abs() < 1e-6);
    let gone = (frame(Some((1.0, 1.5))), folder.path().join("gone.jpg"));
    let error = Scene::of("data", read.map, vec![gone], None).err().unwrap();
    assert!(error.to_string().contains("gone.jpg"), "{error}");
}
