//! Normalisation by domain, the one normalisation that it is compared with, and the statistics that are exported.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;

use grimnet_net::Card;
use grimnet_output::OutputPolicy;
use grimnet_train::data::{PairOptions, Serves, Sources, WeightedSource, WorldOptions};
use grimnet_train::{
    Checkpoint, Data, Detector, Device, ExportOptions, Exported, Figures, Norms, Parameters,
    RunFolder, TrainConfig, Trainer, Validator, Weights, checkpoint_path, export,
    with_export_statistics,
};
use rstest::rstest;

/// Few steps on procedural worlds.
fn short(folder: &Path) -> TrainConfig {
    TrainConfig {
        out: folder.join("run"),
        world_share: 1.0,
        world: WorldOptions {
            worlds: 1,
            places: 4,
        },
        steps: Some(2),
        pairs_per_step: 2,
        global_from: 0.0,
        memory_batches: 0,
        validate_minutes: 0.0,
        pairs: PairOptions {
            side_px: 64,
            points: 12,
            ..PairOptions::default()
        },
        export: ExportOptions {
            whitening_pairs: 0,
            validation_pairs: 1,
            distractors: 2,
            ..ExportOptions::default()
        },
        ..TrainConfig::default()
    }
}

fn run(config: &TrainConfig) -> (Data, Trainer) {
    let data = Data::open(config).unwrap();
    let sources = data.training.clone();
    let mut trainer = Trainer::new(config.clone(), sources, &Device::flex(), false).unwrap();
    trainer.run(&mut |_, _| true).unwrap();
    (data, trainer)
}

/// Parameters as they are exported after a short training.
fn trained(norms: Norms) -> Parameters {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        norms,
        ..short(folder.path())
    };
    let (data, trainer) = run(&config);
    let average = &trainer.state().average;
    with_export_statistics(average, &data.training, &config, &Device::flex()).unwrap()
}

fn values(parameters: &Parameters, name: &str) -> Vec<f32> {
    parameters
        .flat(name)
        .unwrap()
        .into_data()
        .try_to_vec::<f32>()
        .unwrap()
}

#[test]
fn joint_normalisation_leaves_photos_the_maps_and_domains_have_their_own() {
    let joint = trained(Norms::Joint);
    let apart = trained(Norms::ByDomain);
    let layers: Vec<String> = joint
        .names()
        .into_iter()
        .filter(|name| name.contains(".norm.sat."))
        .collect();
    assert!(layers.len() >= 40, "{layers:?}");
    for map in layers {
        let photo = map.replace(".norm.sat.", ".norm.uav.");
        assert_eq!(values(&joint, &map), values(&joint, &photo), "{map}");
        assert_ne!(values(&apart, &map), values(&apart, &photo), "{map}");
    }
}

#[rstest]
#[case::averaged(0.998, false)]
#[case::not_averaged(0.0, true)]
fn statistics_are_those_of_training_where_nothing_is_averaged(
    #[case] average_decay: f32,
    #[case] are_kept: bool,
) {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        average_decay,
        ..short(folder.path())
    };
    let (data, trainer) = run(&config);
    let state = trainer.state();
    let Exported { model, .. } =
        export(state, &config, &data, &Device::flex(), &mut |_| ()).unwrap();
    let exported = Parameters::of_model(&model, &Device::flex());
    for name in ["encoder.0.0.norm.sat.mean", "encoder.4.1.norm.uav.var"] {
        let running = values(&state.average, name);
        assert_eq!(values(&exported, name) == running, are_kept, "{name}");
    }
}

/// The second step is one of retrieval: a network that is trained for matching alone does not normalise by its pictures.
#[test]
fn a_step_of_a_task_without_weight_changes_nothing() {
    let after = |steps: u64| -> Vec<Vec<f32>> {
        let folder = tempfile::tempdir().unwrap();
        let config = TrainConfig {
            alternate: true,
            average_decay: 0.0,
            steps: Some(steps),
            weights: Weights {
                global: 0.0,
                ..Weights::default()
            },
            ..short(folder.path())
        };
        let (_, trainer) = run(&config);
        let parameters = &trainer.state().parameters;
        let names = parameters.names();
        names.iter().map(|name| values(parameters, name)).collect()
    };
    assert!(after(1) == after(2), "the second step changed the network");
}

/// In turns, the pairs of a task that no loss with a weight trains are none of the network's.
#[test]
fn statistics_are_exported_of_the_tasks_that_are_trained() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        alternate: true,
        weights: Weights {
            global: 0.0,
            ..Weights::default()
        },
        ..short(folder.path())
    };
    let (data, trainer) = run(&config);
    let of_other_worlds = TrainConfig {
        seed: 9,
        ..config.clone()
    };
    let serving = |data: &Data, serves| WeightedSource {
        serves,
        ..data.training[0].clone()
    };
    let matching = serving(&data, Serves::Matching);
    let retrieval = serving(&Data::open(&of_other_worlds).unwrap(), Serves::Retrieval);
    let exported = |sources: Sources| {
        let average = &trainer.state().average;
        let found = with_export_statistics(average, &sources, &config, &Device::flex()).unwrap();
        values(&found, "encoder.0.0.norm.uav.mean")
    };
    assert_eq!(
        exported(vec![matching.clone()]),
        exported(vec![matching, retrieval])
    );
}

#[test]
fn a_network_with_one_normalisation_is_validated_as_it_is_exported() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        norms: Norms::Joint,
        average_decay: 0.0,
        validate_minutes: 60.0,
        ..short(folder.path())
    };
    let (data, _) = run(&config);
    let mut state = Checkpoint::open(&checkpoint_path(&config), &Device::flex()).unwrap();
    let measured = |state: &Checkpoint| -> Vec<Figures> {
        let files = RunFolder::open(&config, &OutputPolicy::new()).unwrap();
        let mut validator = Validator::new(&config, &data, &files, 0).unwrap();
        let measured = validator.measure(state).unwrap();
        measured.into_iter().map(|(_, figures)| figures).collect()
    };
    let validated = measured(&state);
    state.config = None;
    assert_ne!(
        measured(&state),
        validated,
        "norms of photos were not trained"
    );
    state.average =
        with_export_statistics(&state.average, &data.training, &config, &Device::flex()).unwrap();
    assert_eq!(measured(&state), validated);
}

#[test]
fn what_uses_the_checkpoint_of_one_normalisation_has_it_for_photos_too() {
    let folder = tempfile::tempdir().unwrap();
    let config = TrainConfig {
        norms: Norms::Joint,
        average_decay: 0.0,
        ..short(folder.path())
    };
    let (data, trainer) = run(&config);
    let checkpoint = checkpoint_path(&config);
    let next = TrainConfig {
        norms: Norms::ByDomain,
        out: folder.path().join("next"),
        start_from: Some(checkpoint.clone()),
        ..config.clone()
    };
    let next = Trainer::new(next, data.training, &Device::flex(), false).unwrap();
    let start = &next.state().parameters;
    for part in ["weight", "bias", "mean", "var"] {
        let [map, photo] = ["sat", "uav"]
            .map(|domain| values(start, &format!("encoder.0.0.norm.{domain}.{part}")));
        assert_eq!(map, photo, "{part}");
    }
    let detector = Detector::open(Some(&checkpoint), &Device::flex()).unwrap();
    assert_eq!(detector.hash(), trainer.state().model().unwrap().hash());
    let untrained = trainer.state().average.to_model(Card::default()).unwrap();
    assert_ne!(detector.hash(), untrained.hash());
}
