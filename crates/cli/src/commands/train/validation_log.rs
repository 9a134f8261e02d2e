//! Validation during training and at its end: held-out data and the flight.

use anyhow::Result;
use grimnet_train::{Checkpoint, Data, Figures, RunFolder, TrainConfig, Validator};
use indicatif::ProgressBar;

use super::flight_log::FlightLog;

/// The tables `validation.csv` and `flight.csv` of a run.
pub(super) struct ValidationLog {
    validator: Validator,
    flight: Option<FlightLog>,
}

impl ValidationLog {
    /// The tables of a run that starts or resumes at `state`.
    pub(super) fn open(
        config: &TrainConfig,
        data: &Data,
        folder: &RunFolder,
        state: &Checkpoint,
    ) -> Result<Self> {
        let step = state.position.step;
        Ok(Self {
            validator: Validator::new(config, data, folder, step)?,
            flight: FlightLog::of(config, folder, step)?,
        })
    }

    /// Adds rows if `validate_minutes` have passed.
    pub(super) fn add_if_due(&mut self, state: &Checkpoint, bar: &ProgressBar) -> Result<()> {
        let measured = self.validator.measure_if_due(state)?;
        self.note(measured, state, bar)
    }

    /// Adds rows for the end of the run, if it is not what was measured last.
    pub(super) fn add_at_end(&mut self, state: &Checkpoint, bar: &ProgressBar) -> Result<()> {
        let measured = self.validator.measure_at_end(state)?;
        self.note(measured, state, bar)
    }

    /// Reports what was measured, and localises the flight at the same steps.
    fn note(
        &mut self,
        measured: Option<Vec<(String, Figures)>>,
        state: &Checkpoint,
        bar: &ProgressBar,
    ) -> Result<()> {
        let Some(measured) = measured else {
            return Ok(());
        };
        for (name, figures) in measured {
            bar.suspend(|| tracing::info!("{name}: {figures}"));
        }
        self.flight
            .as_mut()
            .map_or(Ok(()), |flight| flight.add(state))
    }
}
