//! Normalisation by domain, and the one normalisation that it is compared with.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;

use grimnet_train::data::{PairOptions, WorldOptions};
use grimnet_train::{
    Data, Device, Norms, Parameters, TrainConfig, Trainer, with_recomputed_statistics,
};

/// Trains a few steps on procedural worlds, and recomputes the statistics.
fn trained(folder: &Path, norms: Norms) -> Parameters {
    let config = TrainConfig {
        out: folder.join(format!("{norms:?}")),
        world_share: 1.0,
        world: WorldOptions {
            worlds: 1,
            places: 4,
        },
        norms,
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
        ..TrainConfig::default()
    };
    let data = Data::open(&config).unwrap();
    let device = Device::flex();
    let mut trainer = Trainer::new(config.clone(), data.training.clone(), &device, false).unwrap();
    trainer.run(&mut |_, _| true).unwrap();
    with_recomputed_statistics(&trainer.state().average, &data.training, &config, &device).unwrap()
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
    let folder = tempfile::tempdir().unwrap();
    let joint = trained(folder.path(), Norms::Joint);
    let apart = trained(folder.path(), Norms::ByDomain);
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
