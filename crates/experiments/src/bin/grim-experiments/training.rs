//! The networks of one run, with Ctrl-C and what is shown meanwhile.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result};
use grimnet_eval::scene::Scene;
use grimnet_experiments::experiment_table::ExperimentTable;
use grimnet_experiments::networks::Networks;
use grimnet_experiments::training::{TrainedExperiment, run};
use grimnet_program::{interrupt, progress};
use grimnet_train::{ExportOptions, Progress, TrainConfig};

use crate::arguments::TrainingOptions;
use crate::named::Requested;

/// Minutes of each training where neither a number nor a configuration is given: what `compact` needs for differences to show.
const MINUTES: f64 = 20.0;

/// Minutes between checkpoints where no configuration says otherwise: what a power cut may cost.
const CHECKPOINT_MINUTES: f64 = 1.0;

/// The networks that experiments of a run train, if any does.
pub struct Training {
    networks: Option<Networks>,
}

impl Training {
    /// Prepares training, if any experiment needs it; networks are kept under `work`.
    ///
    /// # Errors
    /// A configuration or data that cannot be used.
    pub fn open(options: &TrainingOptions, requested: &[Requested], work: &Path) -> Result<Self> {
        if !requested.iter().any(|r| matches!(r, Requested::Trained(_))) {
            return Ok(Self { networks: None });
        }
        let stop = Arc::new(AtomicBool::new(false));
        interrupt::stop_on_interrupt(&stop)?;
        let networks = Networks::new(
            configuration(options)?,
            options.train_seeds,
            &work.join("networks"),
            stop,
        )?;
        Ok(Self {
            networks: Some(networks),
        })
    }

    /// The table of an experiment that trains; packs are written to `packs`.
    ///
    /// # Errors
    /// Training or measuring fails, or was stopped.
    pub fn table(
        &mut self,
        experiment: TrainedExperiment,
        scenes: &[Scene],
        packs: &Path,
    ) -> Result<ExperimentTable> {
        let networks = self.networks.as_mut().context("no networks to train")?;
        let bar = progress::spinner(experiment.id());
        let shown = bar.clone();
        networks.on_progress(move |name, progress| shown.set_message(line(name, progress)));
        let table = run(experiment, networks, packs, scenes);
        bar.finish_and_clear();
        Ok(table?)
    }
}

/// The configuration that was named, or the paper's losses and weights on the compact network and procedural worlds.
fn configuration(options: &TrainingOptions) -> Result<TrainConfig> {
    let paper = TrainConfig::paper();
    let named = match &options.train_config {
        Some(path) => TrainConfig::open(path)?,
        None => TrainConfig {
            world_share: 1.0,
            weights: paper.weights,
            descriptor_loss: paper.descriptor_loss,
            global_loss: paper.global_loss,
            minutes: MINUTES,
            steps: None,
            checkpoint_minutes: CHECKPOINT_MINUTES,
            export: ExportOptions {
                // The experiments measure on scenes, not on pairs.
                whitening_pairs: 0,
                // For the card of the model.
                validation_pairs: 24,
                distractors: 0,
                ..ExportOptions::default()
            },
            ..TrainConfig::default()
        },
    };
    Ok(TrainConfig {
        steps: options.train_steps.or(named.steps),
        start_from: options.train_start.clone().or(named.start_from.clone()),
        ..named
    })
}

fn line(name: &str, progress: &Progress) -> String {
    format!(
        "training `{name}`: step {}, {:.0} min left",
        progress.step,
        progress.remaining_s / 60.0
    )
}
