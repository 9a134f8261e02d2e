//! The program `grim-experiments` from end to end, on one small procedural world.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::process::{Command, Output};

use grimnet_experiments::bench::{at_gsd, pack_of};
use grimnet_experiments::experiment_table::ExperimentTable;
use grimnet_experiments::world_flight::WorldFlight;
use grimnet_geo::{MapOptions, open_map};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Pack};
use grimnet_world::{PhotoTags, write_jpeg_with_exif};
use image::RgbImage;

fn program(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_grim-experiments"))
        .args(arguments)
        .output()
        .unwrap()
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// One world of few photos.
const SMALL: [&str; 6] = [
    "--worlds",
    "1",
    "--world-photos",
    "2",
    "--world-size",
    "320",
];

#[test]
fn a_sweep_writes_its_table_and_keeps_files_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let arguments = [
        &["--sweep", "wrong-area", "--out", out.to_str().unwrap()],
        &SMALL[..],
    ]
    .concat();
    let run = program(&arguments);
    assert!(run.status.success(), "{}", errors(&run));
    let table = ExperimentTable::read(&out.join("sweep-wrong-area.json")).unwrap();
    assert_eq!(table.rows.len(), 2);
    let answered = table
        .columns
        .iter()
        .position(|column| column.name == "paper's procedure: with a fix")
        .expect("a column of the paper's procedure");
    for row in &table.rows {
        // It always answers, wherever the photos were taken.
        assert_eq!(row.values[answered], Some(100.0), "{}", row.name);
    }
    assert_eq!(table.conditions["frames"], "2");
    assert!(table.conditions["data"].starts_with("1 procedural worlds of 320 m"));
    let printed = String::from_utf8_lossy(&run.stdout).into_owned();
    assert!(printed.contains(&table.title), "{printed}");
    for name in [
        "sweep-wrong-area.csv",
        "sweep-wrong-area.md",
        "sweeps.html",
        ".grim-output",
    ] {
        assert!(out.join(name).is_file(), "{name}");
    }

    let notes = out.join("sweep-wrong-area.md");
    std::fs::write(&notes, "my notes").unwrap();
    let refused = program(&arguments);
    assert_eq!(refused.status.code(), Some(2));
    let given = errors(&refused);
    assert!(
        given.contains("sweep-wrong-area.md") && given.contains("--overwrite"),
        "{given}"
    );
    assert_eq!(std::fs::read_to_string(&notes).unwrap(), "my notes");
}

#[test]
fn recall_is_measured_among_distractors() {
    let folder = tempfile::tempdir().unwrap();
    let data = data_set(folder.path());
    let distractors = folder.path().join("aerial");
    std::fs::create_dir(&distractors).unwrap();
    for seed in 1..=2_u32 {
        let noise = RgbImage::from_fn(600, 600, |x, y| {
            let tone = (x / 7 * 31 + y / 5 * 17 + seed * 97) % 251;
            image::Rgb([tone as u8; 3])
        });
        noise.save(distractors.join(format!("{seed}.png"))).unwrap();
    }
    let out = folder.path().join("out");
    let run = program(&[
        data.to_str().unwrap(),
        "--distractors",
        distractors.to_str().unwrap(),
        "--gsd",
        "0.3",
        "--heading",
        "known",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert!(run.status.success(), "{}", errors(&run));
    let table = ExperimentTable::read(&out.join("gallery.json")).unwrap();
    assert_eq!(table.columns[0].name, "data, heading known");
    let share = |name: &str| {
        let row = table.rows.iter().find(|row| row.name == name).unwrap();
        row.values[0].unwrap()
    };
    assert!(share("R@1 by descriptor") <= share("R@10 by descriptor"));
    assert_eq!(share("a right tile was matched"), 100.0);
    // Other tiles are searched beside the map's own.
    let model = Model::bundled().unwrap();
    let map = open_map(&data.join("map.tif"), &MapOptions::default()).unwrap();
    let options = at_gsd(BuildOptions::standard(), 0.3);
    let alone = pack_of(map.as_ref(), &model, &options, folder.path()).unwrap();
    let alone = Pack::open(&alone).unwrap().levels()[0].tile_count();
    let tiles: usize = table.notes[1]
        .trim_end_matches(" tiles.")
        .rsplit(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!(tiles > alone, "{tiles} tiles, {alone} of the map");
}

/// A folder with map, a photo and its truth.
fn data_set(folder: &Path) -> std::path::PathBuf {
    let data = folder.join("data");
    let photos = data.join("photos");
    std::fs::create_dir_all(&photos).unwrap();
    let scene = WorldFlight::over("map", 5, 320.0, 0.9, 2)
        .make(&data)
        .unwrap();
    let mut truth = String::from("photo,lat_deg,lon_deg,heading_deg,footprint_w_m\n");
    for shot in &scene.shots {
        let photo = shot.photo.open().unwrap();
        let name = format!("{}.png", shot.name);
        photo.image.save(photos.join(&name)).unwrap();
        let at = shot.truth.position;
        let width_m = photo.view(&shot.known.view).footprint.unwrap().width_m;
        let heading_deg = photo.metadata.gimbal_yaw_deg.unwrap();
        truth += &format!(
            "{name},{},{},{heading_deg},{width_m}\n",
            at.lat_deg, at.lon_deg
        );
    }
    std::fs::write(data.join("truth.csv"), truth).unwrap();
    data
}

#[test]
fn without_any_ground_width_no_row_is_named_after_it() {
    let folder = tempfile::tempdir().unwrap();
    let data = data_set(folder.path());
    let path = data.join("truth.csv");
    let truth = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, truth.replace("footprint_w_m", "unused")).unwrap();
    let out = folder.path().join("out");
    let run = program(&[
        data.to_str().unwrap(),
        "--experiment",
        "success",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(run.status.code(), Some(2));
    let given = errors(&run);
    assert!(
        given.contains("data: no photo's ground width") && given.contains("--footprint-width"),
        "{given}"
    );
}

/// A folder of MSDI's shape with one photo a scene, and the map of each beside it: `(data, maps)`. All lie at the same coordinates.
fn five_scenes(folder: &Path) -> (std::path::PathBuf, Vec<(&'static str, std::path::PathBuf)>) {
    let photos = folder.join("msdi/data/calibrated_images");
    let names = [
        "business_school",
        "energy_center",
        "holy_name_church",
        "metropolitan_university",
        "museum",
    ];
    let made = (20..).zip(names).map(|(seed, name)| {
        let scene = WorldFlight::over(name, seed, 320.0, 0.9, 1)
            .make(&folder.join("maps"))
            .unwrap();
        let shot = &scene.shots[0];
        let photo = shot.photo.open().unwrap();
        let metadata = &photo.metadata;
        let height_m = metadata.relative_altitude_m.unwrap();
        let focal_px = metadata.calibrated_focal_px.unwrap();
        let tags = PhotoTags {
            lat_deg: shot.truth.position.lat_deg,
            lon_deg: shot.truth.position.lon_deg,
            gps_altitude_m: height_m,
            relative_altitude_m: height_m,
            gimbal_yaw_deg: metadata.gimbal_yaw_deg.unwrap(),
            gimbal_pitch_deg: metadata.gimbal_pitch_deg.unwrap(),
            gimbal_roll_deg: metadata.gimbal_roll_deg.unwrap(),
            flight_yaw_deg: metadata.gimbal_yaw_deg.unwrap(),
            focal_length_mm: 4.5,
            focal_35mm: 36.0 * focal_px / f64::from(photo.image.width()),
            calibrated_focal_px: focal_px,
            make: "test".into(),
            model: "test".into(),
            taken: "2026:06:21 10:00:00".into(),
        };
        std::fs::create_dir_all(photos.join(name)).unwrap();
        let path = photos.join(name).join("001.jpg");
        write_jpeg_with_exif(&path, &photo.image, 95, &tags).unwrap();
        (name, folder.join(format!("maps/{name}.tif")))
    });
    let maps = made.collect();
    (folder.join("msdi"), maps)
}

#[test]
fn each_scene_without_a_map_gets_the_one_that_is_named_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let (data, maps) = five_scenes(folder.path());
    let out = folder.path().join("out");
    let with_maps = |named: &[(String, String)], experiment: &str| {
        let mut arguments = vec![data.to_str().unwrap(), "--experiment", experiment];
        arguments.extend(["--out", out.to_str().unwrap()]);
        let named: Vec<String> = named
            .iter()
            .map(|(scene, map)| format!("{scene}={map}"))
            .collect();
        for map in &named {
            arguments.extend(["--scene-map", map]);
        }
        program(&arguments)
    };
    let own: Vec<(String, String)> = maps
        .iter()
        .map(|(scene, map)| ((*scene).to_owned(), map.to_str().unwrap().to_owned()))
        .collect();

    let refused = with_maps(&own[1..], "success");
    assert_eq!(refused.status.code(), Some(2));
    let given = errors(&refused);
    assert!(
        given.contains("MSDI comes without a map") && given.contains("business_school"),
        "{given}"
    );
    let unknown = with_maps(&[("museums".to_owned(), own[4].1.clone())], "success");
    assert_eq!(unknown.status.code(), Some(2));
    let given = errors(&unknown);
    assert!(
        given.contains("--scene-map museums") && given.contains("metropolitan_university"),
        "{given}"
    );

    let run = with_maps(&own, "success");
    assert!(run.status.success(), "{}", errors(&run));
    let table = ExperimentTable::read(&out.join("success.json")).unwrap();
    assert_eq!(table.conditions["frames"], "5");
    let columns: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    let scenes: Vec<&str> = maps.iter().map(|(name, _)| *name).collect();
    assert_eq!(columns, [&scenes[..], &["all frames"]].concat());
    // The maps show other towns at the same coordinates: on a map of another scene no photo could be found.
    let row = table.rows.last().unwrap();
    assert_eq!(row.name, "default mode; heading and scale given");
    assert_eq!(row.values, vec![Some(100.0); 6]);

    let mut swapped = own;
    let first = swapped[0].1.clone();
    swapped[0].1 = std::mem::replace(&mut swapped[1].1, first);
    let run = with_maps(&swapped, "success");
    assert!(run.status.success(), "{}", errors(&run));
    let table = ExperimentTable::read(&out.join("success.json")).unwrap();
    let found = &table.rows.last().unwrap().values[..5];
    assert_eq!(found, [0.0, 0.0, 100.0, 100.0, 100.0].map(Some));
}

#[test]
fn what_cannot_be_done_is_an_error_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let out = out.to_str().unwrap();
    let nothing = program(&["--out", out]);
    assert_eq!(nothing.status.code(), Some(2));
    assert!(
        errors(&nothing).contains("--experiment"),
        "{}",
        errors(&nothing)
    );
    assert!(!Path::new(out).exists());
}
