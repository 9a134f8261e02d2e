//! In builds without the trainer: experiments that train give no table.

use std::path::Path;

use anyhow::Result;
use grimnet_eval::scene::Scene;
use grimnet_experiments::experiment_table::ExperimentTable;

use crate::commands::experiment_options::{ExperimentChoice, ExperimentOptions};

/// What the experiments that train have in common: nothing, in this build.
pub struct Training;

impl Training {
    /// Nothing: options that need the trainer were refused before.
    ///
    /// # Errors
    /// Never.
    pub fn open(_: &ExperimentOptions, _: &Path) -> Result<Self> {
        Ok(Self)
    }

    /// No table.
    ///
    /// # Errors
    /// Never.
    pub fn table(
        &mut self,
        _: ExperimentChoice,
        _: &[Scene],
        _: &Path,
    ) -> Result<Option<ExperimentTable>> {
        Ok(None)
    }
}
