//! What a user gets wrong, and what an interruption leaves behind: clear errors, nothing lost.

#![allow(clippy::unwrap_used)]

use grimnet_net::{Model, NetSpec};
use grimnet_train::data::{Folder, Layout, PairOptions, Serves};
use grimnet_train::{
    Checkpoint, Data, Detector, Device, TrainConfig, TrainError, Trainer, checkpoint_path,
};
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
    let mut trainer = trainer(&config, false).unwrap();
    trainer.run(&mut |_, _| true).unwrap();
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
        ("world_share = 2.0\n", "world_share"),
        ("minutes = 1\n", "[[data]]"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = TrainConfig::open(&path).unwrap_err().to_string();
        assert!(error.contains(word), "{text} gives {error}");
    }
}

#[test]
fn a_checkpoint_of_another_network_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = TrainConfig {
        steps: Some(1),
        ..tiny(folder.path())
    };
    trainer(&config, false)
        .unwrap()
        .run(&mut |_, _| true)
        .unwrap();
    config.network = "vgg16".into();
    let error = trainer(&config, true).err().unwrap().to_string();
    assert!(
        error.contains("vgg16") && error.contains("checkpoint.safetensors"),
        "{error}"
    );
    // A larger network may grow from it, and one that differs in NetVLAD takes the rest; no smaller one fits.
    config.start_from = Some(checkpoint_path(&config));
    assert!(trainer(&config, false).is_ok());
    config.network = "compact".into();
    let mut other = NetSpec::compact();
    other.vlad.clusters = 16;
    let path = folder.path().join("other.safetensors");
    Model::random(&other, 1).unwrap().save(&path).unwrap();
    config.start_from = Some(path);
    assert!(trainer(&config, false).is_ok());
    let mut wider = NetSpec::compact();
    wider.stages[0].widths = vec![32, 32];
    let path = folder.path().join("wider.safetensors");
    Model::random(&wider, 1).unwrap().save(&path).unwrap();
    config.start_from = Some(path);
    let error = trainer(&config, false).err().unwrap().to_string();
    assert!(
        error.contains("another network") && error.contains("wider.safetensors"),
        "{error}"
    );
}

#[test]
fn resuming_what_never_began_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let error = trainer(&tiny(folder.path()), true)
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("without resuming"), "{error}");
}

#[test]
fn a_damaged_checkpoint_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        steps: Some(1),
        ..tiny(folder.path())
    };
    trainer(&config, false)
        .unwrap()
        .run(&mut |_, _| true)
        .unwrap();
    let path = checkpoint_path(&config);
    let bytes = std::fs::read(&path).unwrap();
    // Cut short, it still says what it is: whoever would start from it, or detect with it, learns what is wrong.
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let from = TrainConfig {
        out: folder.path().join("next"),
        start_from: Some(path.clone()),
        ..config.clone()
    };
    let start = trainer(&from, false).err().unwrap();
    let detector = Detector::open(Some(&path), &Device::flex()).err().unwrap();
    for error in [start, detector] {
        assert!(
            matches!(&error, TrainError::Checkpoint { path: named, .. } if *named == path),
            "{error}"
        );
    }
    for bytes in [&bytes[..bytes.len() / 2], b"", b"short"] {
        std::fs::write(&path, bytes).unwrap();
        let error = trainer(&config, true).err().unwrap();
        assert!(
            matches!(&error, TrainError::Checkpoint { path: named, .. } if *named == path),
            "{error}"
        );
    }
}

#[test]
fn a_loss_that_is_no_number_names_the_last_good_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny(folder.path());
    trainer(&config, false)
        .unwrap()
        .run(&mut |_, _| true)
        .unwrap();
    let good = std::fs::read(checkpoint_path(&config)).unwrap();
    let wild = TrainConfig {
        learning_rate: 1e30,
        warmup_steps: 1,
        steps: Some(40),
        ..config.clone()
    };
    let error = trainer(&wild, true)
        .unwrap()
        .run(&mut |_, _| true)
        .unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, TrainError::NotFinite { .. }), "{text}");
    assert!(
        text.contains(&checkpoint_path(&config).display().to_string()),
        "{text}"
    );
    assert_eq!(std::fs::read(checkpoint_path(&config)).unwrap(), good);
}

/// A run that was ended after two steps and resumed is, number by number, the run that was not; what a kill leaves of a
/// half-written file is in nobody's way.
#[test]
fn a_resumed_run_is_the_run_that_was_never_interrupted() {
    let folder = tempfile::tempdir().unwrap();
    let whole = tiny(folder.path());
    trainer(&whole, false)
        .unwrap()
        .run(&mut |_, _| true)
        .unwrap();
    let cut = TrainConfig {
        out: folder.path().join("cut"),
        ..whole.clone()
    };
    trainer(&cut, false)
        .unwrap()
        .run(&mut |progress, _| progress.step < 2)
        .unwrap();
    std::fs::write(cut.out.join(".tmpHalf"), b"half a checkpoint").unwrap();
    let mut second = trainer(&cut, true).unwrap();
    assert_eq!(second.state().position.step, 2);
    second.run(&mut |_, _| true).unwrap();
    let values = |config: &TrainConfig| {
        let state = Checkpoint::open(&checkpoint_path(config), &Device::flex()).unwrap();
        state.parameters.to_host().unwrap()
    };
    assert!(values(&whole) == values(&cut));
}
