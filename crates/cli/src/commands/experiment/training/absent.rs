//! What stands in for training in builds without the trainer.

use std::path::Path;

use anyhow::{Result, bail};
use grimnet_eval::experiment::scene::Scene;
use grimnet_eval::experiment::tables::Recipe;
use grimnet_eval::experiment_table::ExperimentTable;

use crate::commands::experiment::{ExperimentChoice, ExperimentOptions};

/// What the experiments that train have in common: nothing, in this build.
pub struct Training;

impl Training {
    /// Says how to get the trainer, if it is needed.
    ///
    /// # Errors
    /// An experiment was asked for that trains.
    pub fn open(options: &ExperimentOptions, _: &Path) -> Result<Self> {
        match options.experiments.iter().find(|choice| choice.trains()) {
            None => Ok(Self),
            Some(choice) => bail!(
                "--experiment {} trains networks, and this grim was built without the trainer; build it with: cargo build --release -p grimnet-cli --features train",
                choice.name()
            ),
        }
    }

    /// No table: nothing that trains gets past [`Training::open`].
    ///
    /// # Errors
    /// Never.
    pub fn table(
        &mut self,
        _: ExperimentChoice,
        _: &[Scene],
        _: Recipe,
        _: &Path,
    ) -> Result<Option<ExperimentTable>> {
        Ok(None)
    }
}
