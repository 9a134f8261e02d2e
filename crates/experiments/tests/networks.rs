//! Networks of an experiment: made once, gone on with after a stop, given apart by their budgets.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use grimnet_experiments::networks::{Networks, NetworksError};
use grimnet_train::data::{PairOptions, WorldOptions};
use grimnet_train::{ExportOptions, TrainConfig};

/// Four short steps on one procedural world.
fn budget() -> TrainConfig {
    TrainConfig {
        world_share: 1.0,
        world: WorldOptions {
            worlds: 1,
            places: 2,
        },
        steps: Some(4),
        pairs_per_step: 2,
        memory_batches: 0,
        pairs: PairOptions {
            side_px: 64,
            points: 12,
            ..PairOptions::default()
        },
        export: ExportOptions {
            whitening_pairs: 0,
            validation_pairs: 24,
            distractors: 0,
            ..ExportOptions::default()
        },
        ..TrainConfig::default()
    }
}

/// Networks of some seeds that count their steps and stop after `last`.
fn stopping_after(
    last: u64,
    seeds: u64,
    config: TrainConfig,
    folder: &Path,
) -> (Networks, Arc<AtomicU64>) {
    let stop = Arc::new(AtomicBool::new(false));
    let steps = Arc::new(AtomicU64::new(0));
    let mut networks = Networks::new(config, seeds, folder, stop.clone()).unwrap();
    let counted = steps.clone();
    networks.on_progress(move |_, progress| {
        counted.fetch_add(1, Ordering::Relaxed);
        stop.store(progress.step >= last, Ordering::Relaxed);
    });
    (networks, steps)
}

#[test]
fn a_stopped_network_is_gone_on_with_and_a_finished_one_is_not_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let (networks, steps) = stopping_after(1, 1, budget(), folder.path());
    let error = networks.get("joint", |_| {}).err().unwrap();
    assert!(
        matches!(&error, NetworksError::Stopped { step: 1, name, .. } if name.starts_with("joint, seed ")),
        "{error}"
    );
    assert_eq!(steps.load(Ordering::Relaxed), 1);

    let (networks, steps) = stopping_after(u64::MAX, 1, budget(), folder.path());
    let hash =
        |networks: &Networks, i: usize| networks.get("joint", |_| {}).unwrap()[i].model.hash();
    let trained = networks.get("joint", |_| {}).unwrap();
    let made = &trained[0].model;
    assert_eq!(trained.len(), 1);
    assert_eq!(trained[0].last_fall, None, "too short to tell");
    assert_eq!(steps.load(Ordering::Relaxed), 3, "one step was kept");
    assert_eq!(made.card().steps, 4);
    assert_eq!(hash(&networks, 0), made.hash());
    assert_eq!(steps.load(Ordering::Relaxed), 3, "nothing was trained");

    let longer = TrainConfig {
        steps: Some(5),
        ..budget()
    };
    let (networks, steps) = stopping_after(u64::MAX, 2, longer, folder.path());
    assert_ne!(hash(&networks, 0), made.hash());
    assert_ne!(hash(&networks, 1), hash(&networks, 0), "another seed");
    assert_eq!(
        steps.load(Ordering::Relaxed),
        10,
        "another budget, another network"
    );
}
