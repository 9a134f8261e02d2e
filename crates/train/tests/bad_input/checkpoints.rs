//! Checkpoints that are missing, damaged or of another run, and what an interruption leaves behind.

use super::{run, tiny, trainer};
use grimnet_net::{Model, NetSpec};
use grimnet_train::{
    Checkpoint, Data, Detector, Device, TrainConfig, TrainError, checkpoint_path, export,
};
use std::path::Path;

/// Trains for one step; with which settings.
fn one_step_run(folder: &Path) -> TrainConfig {
    let config = TrainConfig {
        steps: Some(1),
        ..tiny(folder)
    };
    run(&config, false).unwrap();
    config
}

#[test]
fn a_checkpoint_of_another_network_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = one_step_run(folder.path());
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
    let config = one_step_run(folder.path());
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
fn a_checkpoint_in_place_of_a_model_is_to_be_exported() {
    let folder = tempfile::tempdir().unwrap();
    let config = one_step_run(folder.path());
    let error = Model::open(checkpoint_path(&config)).err().unwrap();
    assert!(
        error.to_string().contains("until it is exported"),
        "{error}"
    );
}

#[test]
fn a_loss_that_is_no_number_names_the_last_good_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny(folder.path());
    run(&config, false).unwrap();
    let good = std::fs::read(checkpoint_path(&config)).unwrap();
    let wild = TrainConfig {
        learning_rate: 1e30,
        warmup_steps: 1,
        steps: Some(40),
        ..config.clone()
    };
    let error = run(&wild, true).err().unwrap();
    let text = error.to_string();
    assert!(matches!(error, TrainError::NotFinite { .. }), "{text}");
    assert!(
        text.contains(&checkpoint_path(&config).display().to_string()),
        "{text}"
    );
    assert_eq!(std::fs::read(checkpoint_path(&config)).unwrap(), good);
    // A run that has saved nothing yet names no file.
    let wild = TrainConfig {
        out: folder.path().join("wild"),
        ..wild
    };
    let error = run(&wild, false).err().unwrap();
    assert!(
        matches!(
            error,
            TrainError::NotFinite {
                checkpoint: None,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn a_new_run_does_not_replace_another() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        steps: Some(2),
        ..tiny(folder.path())
    };
    run(&config, false).unwrap();
    let before = std::fs::read(checkpoint_path(&config)).unwrap();
    let error = run(&config, false).err().unwrap();
    assert!(
        matches!(error, TrainError::EarlierRun { step: 2, .. }),
        "{error}"
    );
    assert_eq!(std::fs::read(checkpoint_path(&config)).unwrap(), before);
}

#[test]
fn a_run_is_resumed_with_its_settings_but_for_the_schedule() {
    let folder = tempfile::tempdir().unwrap();
    let config = one_step_run(folder.path());
    let longer = TrainConfig {
        steps: Some(2),
        learning_rate: 1e-4,
        ..config.clone()
    };
    let resumed = trainer(&longer, true).unwrap();
    assert_eq!(resumed.state().config, Some(longer), "what is saved next");
    let other = TrainConfig {
        seed: 99,
        pairs_per_step: 2,
        ..config.clone()
    };
    let error = trainer(&other, true).err().unwrap().to_string();
    for word in [
        "`seed` was 1, now 99",
        "`pairs_per_step` was 3, now 2",
        "checkpoint.safetensors",
    ] {
        assert!(error.contains(word), "{error}");
    }
    // Earlier versions did not record the settings.
    let path = checkpoint_path(&config);
    let mut state = Checkpoint::open(&path, &Device::flex()).unwrap();
    state.config = None;
    std::fs::write(&path, state.to_bytes().unwrap()).unwrap();
    assert_eq!(
        Checkpoint::open(&path, &Device::flex()).unwrap().config,
        None
    );
    assert!(trainer(&other, true).is_ok());
}

#[test]
fn a_model_with_a_random_netvlad_is_not_exported() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        steps: Some(1),
        global_from: 0.9,
        ..tiny(folder.path())
    };
    let trainer = run(&config, false).unwrap();
    let data = Data::open(&config).unwrap();
    let exported = export(
        trainer.state(),
        &config,
        &data,
        &Device::flex(),
        &mut |_| (),
    );
    let error = exported.unwrap_err().to_string();
    assert!(
        error.contains("NetVLAD") && error.contains("global_from"),
        "{error}"
    );
}

/// A run that was ended after two steps and resumed is, number by number, the run that was not; what a kill leaves of a
/// half-written file is in nobody's way.
#[test]
fn a_resumed_run_is_the_run_that_was_never_interrupted() {
    let folder = tempfile::tempdir().unwrap();
    let whole = tiny(folder.path());
    run(&whole, false).unwrap();
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

#[test]
fn a_damaged_model_to_start_from_is_not_taken_for_another_programs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.safetensors");
    Model::random(&NetSpec::compact(), 1)
        .unwrap()
        .save(&path)
        .unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let mut config = tiny(folder.path());
    config.start_from = Some(path);
    let error = trainer(&config, false).err().unwrap().to_string();
    assert!(
        error.contains("checksum") && error.contains("damaged.safetensors"),
        "{error}"
    );
}

#[test]
fn a_checkpoint_that_does_not_fit_its_description_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let config = one_step_run(folder.path());
    let path = checkpoint_path(&config);
    let mut bytes = std::fs::read(&path).unwrap();
    let (from, to) = (
        r#"descriptor_dim\":128"#.as_bytes(),
        r#"descriptor_dim\":127"#.as_bytes(),
    );
    let at = bytes.windows(from.len()).position(|window| window == from);
    bytes[at.unwrap()..][..to.len()].copy_from_slice(to);
    std::fs::write(&path, bytes).unwrap();
    let error = trainer(&config, true).err().unwrap().to_string();
    assert!(
        error.contains("checkpoint.safetensors") && error.contains("128 values"),
        "{error}"
    );
}
