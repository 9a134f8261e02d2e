//! A small run of each stage lowers its loss, and the next one starts from it.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_output::OutputPolicy;
use grimnet_train::data::{
    Folder, LABEL_NONE, LabelOptions, Layout, Look, PairOptions, Serves, batch_of,
};
use grimnet_train::{
    Checkpoint, Data, Device, Figures, Losses, RunFolder, Stage, TrainConfig, TrainError, Trainer,
    Validator, checkpoint_path, label_pictures,
};
use image::{Rgb, RgbImage};
use std::path::Path;

/// Two scene classes of 24 pictures each: green stripes, and grey blots.
fn classes(folder: &Path) -> Folder {
    let path = folder.join("classes");
    for i in 0..48u32 {
        let class = path.join(if i % 2 == 0 { "field" } else { "town" });
        std::fs::create_dir_all(&class).unwrap();
        RgbImage::from_fn(96, 96, |x, y| {
            let striped = (y + x / 8) / (3 + i % 4) % 2 * 150;
            let blot = (x / (9 + i % 3)) * 7 + (y / 9) * (13 + i);
            let blots = (blot.wrapping_mul(2_654_435_761) >> 25) + 40;
            if i % 2 == 0 {
                Rgb([20 + striped as u8 / 2, 40 + striped as u8, 30])
            } else {
                Rgb([blots as u8, blots as u8, (blots + i % 5 * 8) as u8])
            }
        })
        .save(class.join(format!("{i}.png")))
        .unwrap();
    }
    Folder {
        path,
        repeat: 1,
        layout: Layout::Classes,
        serves: Serves::default(),
    }
}

/// Hardly any change, so that seconds of training are enough.
fn plain_look() -> Look {
    Look {
        sat_strength: 0.1,
        uav_strength: 0.1,
        equalised: 0.0,
        shadows: 0.0,
        haze: 0.0,
        season: 0.0,
        ..Look::default()
    }
}

fn small(stage: Stage, folder: &Path, steps: u64) -> TrainConfig {
    TrainConfig {
        stage,
        out: folder.join(stage.to_string()),
        steps: Some(steps),
        pairs_per_step: 4,
        report_steps: 10,
        warmup_steps: 5,
        learning_rate: 3e-3,
        validate_minutes: 0.0,
        pairs: PairOptions {
            side_px: 64,
            points: 12,
            group: 2,
            ..PairOptions::default()
        },
        ..TrainConfig::default()
    }
}

/// The mean losses of every ten steps.
fn trained(config: &TrainConfig) -> Vec<Losses> {
    let data = Data::open(config).unwrap();
    let mut trainer = Trainer::new(config.clone(), data.training, &Device::flex(), false).unwrap();
    let mut losses = Vec::new();
    let mut keep = |progress: &grimnet_train::Progress, _: &Checkpoint| {
        losses.push(progress.losses);
        true
    };
    trainer.run(&mut keep).unwrap();
    losses
}

/// What the keypoint loss cannot fall below without looking: the weighted entropy of the labels.
fn blind_loss(config: &TrainConfig) -> f32 {
    let data = Data::open(config).unwrap();
    let mut mass = [0.0f32; 65];
    for step in 0..60 {
        for pair in batch_of(&data.training, None, &config.pairs, 4, 9, step) {
            let seen = pair.uav_labels.iter().zip(&pair.uav_seen);
            let seen = seen.filter_map(|(label, seen)| seen.then_some(label));
            for &label in pair.sat_labels.iter().chain(seen) {
                let none = label == LABEL_NONE;
                mass[label as usize] += if none { config.weights.dustbin } else { 1.0 };
            }
        }
    }
    let total: f32 = mass.iter().sum();
    let shares = mass.iter().map(|m| m / total).filter(|p| *p > 0.0);
    shares.map(|p| -p * p.ln()).sum()
}

#[test]
fn shapes_teach_the_keypoint_head_to_look() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        pairs: PairOptions {
            side_px: 96,
            ..small(Stage::Shapes, folder.path(), 0).pairs
        },
        ..small(Stage::Shapes, folder.path(), 1000)
    };
    let losses = trained(&config);
    let blind = blind_loss(&config);
    let end = &losses[losses.len() - 30..];
    let keypoint = end.iter().filter_map(|losses| losses.keypoint).sum::<f32>() / end.len() as f32;
    assert!(keypoint < losses[0].keypoint.unwrap(), "{losses:?}");
    assert!(keypoint < 0.93 * blind, "{keypoint} of {blind}");
    let last = losses[losses.len() - 1];
    assert_eq!(
        (last.descriptor, last.global, last.scene),
        (None, None, None)
    );
}

#[test]
fn scenes_teach_the_encoder_and_the_joint_stage_starts_from_it() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        data: vec![classes(folder.path())],
        validate_minutes: 1.0,
        learning_rate: 1e-3,
        pairs: PairOptions {
            black_corners: 0.0,
            look: plain_look(),
            ..small(Stage::Scenes, folder.path(), 0).pairs
        },
        ..small(Stage::Scenes, folder.path(), 60)
    };
    let losses = trained(&config);
    let [first, last] = [0, losses.len() - 1].map(|i| losses[i].scene.unwrap());
    assert!(first < 1.0 && last < 0.8 * first, "{losses:?}");
    let state = Checkpoint::open(&checkpoint_path(&config), &Device::flex()).unwrap();
    assert_eq!(state.parameters.scenes(), 2);
    let out = RunFolder::open(&config, &OutputPolicy::new()).unwrap();
    let data = Data::open(&config).unwrap();
    let rows = || {
        let table = std::fs::read_to_string(out.path().join("validation.csv")).unwrap();
        table.lines().count() - 1
    };
    let mut validator = Validator::new(&config, &data, &out, 60).unwrap();
    let measured = validator.measure_at_end(&state).unwrap().unwrap();
    assert!(!measured.is_empty());
    assert_eq!(rows(), measured.len());
    assert!(
        validator.measure_at_end(&state).unwrap().is_none(),
        "the same step"
    );
    let mut none_held_out = data.clone();
    none_held_out.held_out.clear();
    let mut validator = Validator::new(&config, &none_held_out, &out, 30).unwrap();
    let due = validator.measure_at_end(&state).unwrap();
    assert_eq!(due, Some(Vec::new()), "the flight is due");
    Validator::new(&config, &data, &out, 30).unwrap();
    assert_eq!(rows(), 0, "step 60 is trained again");
    for (_, figures) in &measured {
        assert!(
            matches!(figures, Figures::Scenes(v) if v.share > 0.7),
            "{figures}"
        );
    }

    let joint = TrainConfig {
        data: config.data.clone(),
        start_from: Some(checkpoint_path(&config)),
        global_from: 0.5,
        ..small(Stage::Joint, folder.path(), 4)
    };
    trained(&joint);
    let next = Checkpoint::open(&checkpoint_path(&joint), &Device::flex()).unwrap();
    assert!(next.position.centres_started);
    assert_eq!(next.parameters.scenes(), 0);
    assert!(next.average.to_model(grimnet_net::Card::default()).is_ok());
}

#[test]
fn a_checkpoint_of_another_stage_is_not_gone_on_from() {
    let folder = tempfile::tempdir().unwrap();
    let config = small(Stage::Shapes, folder.path(), 1);
    trained(&config);
    let other = TrainConfig {
        stage: Stage::Scenes,
        data: vec![classes(folder.path())],
        ..config
    };
    let data = Data::open(&other).unwrap();
    let error = Trainer::new(other, data.training, &Device::flex(), true).err();
    let error = error.unwrap();
    assert!(matches!(error, TrainError::Checkpoint { .. }), "{error}");
    assert!(error.to_string().contains("stage `shapes`"), "{error}");
}

#[test]
fn scenes_need_classes() {
    let folder = tempfile::tempdir().unwrap();
    let mut data = classes(folder.path());
    data.layout = Layout::Pictures;
    let config = TrainConfig {
        data: vec![data],
        ..small(Stage::Scenes, folder.path(), 1)
    };
    let sources = Data::open(&config).unwrap().training;
    let error = Trainer::new(config, sources, &Device::flex(), false).err();
    assert!(error.unwrap().to_string().contains("layout = \"classes\""));
}

/// Shapes teach a detector, the detector labels pictures, and the joint stage reads what it found; what was labelled before is
/// not labelled again.
#[test]
fn a_detector_labels_pictures_for_the_joint_stage() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = small(Stage::Shapes, folder.path(), 20);
    trained(&shapes);
    let joint = TrainConfig {
        data: vec![classes(folder.path())],
        labels: Some(LabelOptions {
            folder: folder.path().join("labels"),
            detector: Some(checkpoint_path(&shapes)),
            views: 10,
            side_px: 96,
            threshold: 0.0,
            ..LabelOptions::default()
        }),
        ..small(Stage::Joint, folder.path(), 4)
    };
    let device = Device::flex();
    let error = Data::open(&joint).err().unwrap().to_string();
    assert!(error.contains("have no labels"), "{error}");

    let first = label_pictures(&joint, &device, &mut |_| false).unwrap();
    assert!(
        first.labelled > 0 && first.labelled < first.pictures,
        "{first:?}"
    );
    let second = label_pictures(&joint, &device, &mut |_| true).unwrap();
    assert_eq!(second.labelled, second.pictures);
    assert_eq!(first.of_this_run + second.of_this_run, second.pictures);
    assert!(second.keypoints > 0);

    let source = Data::open(&joint).unwrap().training;
    let with_labels = batch_of(&source, None, &joint.pairs, 4, 1, 0);
    let labelled = with_labels.iter().flat_map(|pair| &pair.sat_labels);
    assert!(labelled.filter(|label| **label != LABEL_NONE).count() > 20);
    let corners = TrainConfig {
        labels: None,
        ..joint.clone()
    };
    let source = Data::open(&corners).unwrap().training;
    for (a, b) in with_labels
        .iter()
        .zip(batch_of(&source, None, &joint.pairs, 4, 1, 0))
    {
        assert_eq!(a.sat, b.sat);
        assert_ne!(a.sat_labels, b.sat_labels);
    }
    trained(&joint);

    let nothing = TrainConfig {
        labels: joint.labels.clone().map(|labels| LabelOptions {
            threshold: 0.99,
            folder: folder.path().join("refused"),
            ..labels
        }),
        ..joint.clone()
    };
    let error = label_pictures(&nothing, &device, &mut |_| true).unwrap_err();
    assert!(error.to_string().contains("threshold"), "{error}");
    let inside = |path: &Path| -> Vec<_> {
        let entries = std::fs::read_dir(path).unwrap();
        entries.map(|entry| entry.unwrap().path()).collect()
    };
    let left = inside(&folder.path().join("refused"));
    let left: Vec<_> = left.iter().flat_map(|path| inside(path)).collect();
    assert!(left.is_empty(), "a training run would take them: {left:?}");

    let more = TrainConfig {
        labels: joint.labels.clone().map(|labels| LabelOptions {
            views: 11,
            ..labels
        }),
        ..joint
    };
    assert!(Data::open(&more).is_err());
}
