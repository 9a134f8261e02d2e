//! What a user gets wrong, and what an interruption leaves behind: clear errors, nothing lost.

#![allow(clippy::unwrap_used)]

#[path = "bad_input/checkpoints.rs"]
mod checkpoints;

use grimnet_train::data::{Folder, LabelOptions, Layout, PairOptions, Serves};
use grimnet_train::{Data, Device, TrainConfig, TrainError, Trainer, label_pictures};
use image::{Rgb, RgbImage};
use std::path::Path;

/// Twelve pictures with something to see in them, under `folder/pictures`.
fn pictures(folder: &Path) -> Folder {
    let path = folder.join("pictures");
    std::fs::create_dir_all(&path).unwrap();
    for i in 0..12u32 {
        RgbImage::from_fn(120, 110, |x, y| {
            let block = (x / (5 + i % 3)) * 7 + (y / 6) * (3 + i) + i * i;
            let v = (block.wrapping_mul(2_654_435_761) >> 24) as u8;
            Rgb([v, v.wrapping_add((x + i) as u8), 255 - v])
        })
        .save(path.join(format!("{i}.png")))
        .unwrap();
    }
    Folder {
        path,
        repeat: 1,
        layout: Layout::Pictures,
        serves: Serves::default(),
    }
}

/// A run of some seconds.
fn tiny(folder: &Path) -> TrainConfig {
    TrainConfig {
        out: folder.join("out"),
        data: vec![pictures(folder)],
        steps: Some(4),
        pairs_per_step: 3,
        report_steps: 1,
        global_from: 0.0,
        memory_batches: 0,
        pairs: PairOptions {
            side_px: 64,
            points: 12,
            ..PairOptions::default()
        },
        ..TrainConfig::default()
    }
}

fn trainer(config: &TrainConfig, resume: bool) -> Result<Trainer, TrainError> {
    let data = Data::open(config)?;
    Trainer::new(config.clone(), data.training, &Device::flex(), resume)
}

/// Trains to the end, and gives what was trained.
fn run(config: &TrainConfig, resume: bool) -> Result<Trainer, TrainError> {
    let mut trainer = trainer(config, resume)?;
    trainer.run(&mut |_, _| true)?;
    Ok(trainer)
}

#[test]
fn unreadable_pictures_are_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny(folder.path());
    let broken = config.data[0].path.join("broken.jpg");
    std::fs::write(broken, b"no picture at all").unwrap();
    std::fs::write(config.data[0].path.join("notes.txt"), b"not even a name").unwrap();
    RgbImage::new(9, 9)
        .save(config.data[0].path.join("stamp.png"))
        .unwrap();
    let data = Data::open(&config).unwrap();
    assert_eq!(data.unreadable, 2);
    assert!((8..=12).contains(&data.pictures));
}

/// The header is fine, the pixels are cut off: found out while training, which goes on.
#[test]
fn a_picture_that_breaks_while_decoding_is_replaced_by_another() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny(folder.path());
    let path = config.data[0].path.join("3.png");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 3]).unwrap();
    let trainer = run(&config, false).unwrap();
    assert_eq!(trainer.state().position.step, 4);
}

#[test]
fn too_few_pictures_and_missing_folders_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = tiny(folder.path());
    for i in 3..12 {
        std::fs::remove_file(config.data[0].path.join(format!("{i}.png"))).unwrap();
    }
    let error = trainer(&config, false).err().unwrap();
    assert!(
        matches!(error, TrainError::TooFewPictures { found, .. } if found <= 3),
        "{error}"
    );
    config.data[0].path = folder.path().join("nowhere");
    let error = trainer(&config, false).err().unwrap().to_string();
    assert!(error.contains("nowhere"), "{error}");
}

#[test]
fn pictures_that_are_too_small_are_not_called_unreadable_alone() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = tiny(folder.path());
    config.pairs.side_px = 160;
    let error = trainer(&config, false).err().unwrap().to_string();
    assert!(
        error.contains("12 cannot be read or are too small for `pairs.side_px`"),
        "{error}"
    );
}

#[test]
fn a_data_set_of_another_layout_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = tiny(folder.path());
    config.data[0].layout = Layout::Vtrn;
    let error = trainer(&config, false).err().unwrap().to_string();
    assert!(error.contains("Train/query_images"), "{error}");
}

#[test]
fn pictures_that_vanish_end_the_run_with_advice() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny(folder.path());
    let mut trainer = trainer(&config, false).unwrap();
    std::fs::remove_dir_all(&config.data[0].path).unwrap();
    let error = trainer.run(&mut |_, _| true).unwrap_err();
    assert!(matches!(error, TrainError::NoPairs { step: 0 }), "{error}");
}

#[test]
fn a_configuration_with_a_wrong_key_or_value_says_which() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("training.toml");
    for (text, word) in [
        ("minuts = 3\n", "minuts"),
        ("network = \"resnet\"\n", "resnet"),
        ("[pairs]\nside_px = 100\n", "side_px"),
        (
            "[pairs]\nside_px = 1000000\n",
            "`pairs.side_px` is 1000000; it must be from 1 to 4096",
        ),
        (
            "pairs_per_step = 4000000000\n",
            "`pairs_per_step` is 4000000000; it must be from 2 to 65536",
        ),
        ("[labels]\nside_px = 9600\n", "`labels.side_px` is 9600"),
        (
            "world_share = 1\n[pairs]\nside_px = 128\n",
            "`pairs.points` is 256; with `pairs.side_px = 128` it must be at most 128",
        ),
        ("world_share = 2.0\n", "world_share"),
        ("minutes = 1\n", "[[data]]"),
        ("global_from = 1.0\n", "`global_from` is 1; it must be"),
        (
            "minutes = inf\n",
            "`minutes` is inf; it must be finite and above 0",
        ),
        (
            "validate_minutes = inf\n",
            "`validate_minutes` is inf; it must be finite and at least 0",
        ),
        ("encoder_rate = -1.0\n", "`encoder_rate` is -1"),
        ("decay_from = -1.0\n", "decay_from"),
        ("average_decay = -3.0\n", "average_decay"),
        ("descriptor_temperature = 0.0\n", "descriptor_temperature"),
        ("learning_rate = nan\n", "learning_rate"),
        ("steps = 0\n", "steps"),
        ("[weights]\nkeypoint = -1.0\n", "weights.keypoint"),
        (
            "world_share = 1\n[labels.look]\nmixed = 0.2\n",
            "labels.look.mixed",
        ),
        (
            "world_share = 1\n[weights]\nkeypoint = 0\ndescriptor = 0\nglobal = 0\n",
            "all `weights` are 0",
        ),
        (
            "world_share = 1\n[weights]\nkeypoint = 0\ndescriptor = 0\nglobal = 0\n\
             [teacher]\nkeypoint = 0\ndescriptor = 0\nglobal = 0\n",
            "all `weights` are 0",
        ),
        ("[triplet]\nhardest = 0\n", "triplet.hardest"),
        ("[pairs.look]\nseason = 1.5\n", "pairs.look.season"),
        ("[[data]]\npath = \".\"\nrepeat = 0\n", "data[0].repeat"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = TrainConfig::open(&path).unwrap_err().to_string();
        assert!(error.contains(word), "{text} gives {error}");
    }
}

#[test]
fn the_steps_after_the_last_report_are_reported_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        steps: Some(2),
        report_steps: 50,
        ..tiny(folder.path())
    };
    let mut reported = Vec::new();
    let mut trainer = trainer(&config, false).unwrap();
    trainer
        .run(&mut |progress, _| {
            reported.push(progress.step);
            true
        })
        .unwrap();
    assert_eq!(reported.last(), Some(&2));
}

#[test]
fn the_time_of_a_validation_is_not_that_of_the_next_steps() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        steps: Some(2),
        ..tiny(folder.path())
    };
    let mut speeds = Vec::new();
    let mut trainer = trainer(&config, false).unwrap();
    let pause_s = 3.0;
    trainer
        .run(&mut |progress, _| {
            speeds.push(progress.pairs_per_s);
            std::thread::sleep(std::time::Duration::from_secs_f64(pause_s));
            true
        })
        .unwrap();
    assert!(
        speeds[1] > config.pairs_per_step as f64 / pause_s,
        "{speeds:?}"
    );
}

#[test]
fn a_picture_belongs_to_one_folder() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = pictures(folder.path());
    let opened = |folders: [Folder; 2]| {
        Data::open(&TrainConfig {
            data: folders.into(),
            alternate: true,
            ..tiny(folder.path())
        })
    };
    let at = |path: &Path, serves| Folder {
        path: path.to_owned(),
        serves,
        ..pictures.clone()
    };
    let path = pictures.path.as_path();
    let same = path.join("../pictures");
    for other in [folder.path(), &same] {
        let error = opened([pictures.clone(), at(other, Serves::Both)]);
        let error = error.err().unwrap().to_string();
        assert!(
            error.contains("[[data]]") && error.contains("pictures"),
            "{error}"
        );
    }
    let by_task = [Serves::Retrieval, Serves::Matching].map(|serves| at(path, serves));
    // In two layouts other pictures are held out.
    let mut in_two_layouts = by_task.clone();
    in_two_layouts[0].layout = Layout::Vtrn;
    let error = opened(in_two_layouts).err().unwrap().to_string();
    assert!(error.contains("`layout`"), "{error}");
    assert!(opened(by_task).is_ok());
}

#[test]
fn a_number_of_threads_that_would_stop_the_machine_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let with = |data_threads| TrainConfig {
        data_threads,
        ..tiny(folder.path())
    };
    assert!(with(256).validate().is_ok());
    for data_threads in [0, 257] {
        let error = with(data_threads).validate().unwrap_err().to_string();
        assert!(error.contains("`data_threads`"), "{error}");
    }
}

#[test]
fn labels_for_no_folder_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        data: Vec::new(),
        world_share: 1.0,
        labels: Some(LabelOptions::default()),
        ..tiny(folder.path())
    };
    let error = label_pictures(&config, &Device::flex(), &mut |_| true);
    let error = error.err().unwrap().to_string();
    assert!(error.contains("needs labels"), "{error}");
}
