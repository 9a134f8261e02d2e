//! Localisation accuracy during training: a procedural flight, localised at each validation, with a row in `flight.csv`.

use anyhow::Result;
use grimnet_eval::validation_flight::ValidationFlight;
use grimnet_train::{Checkpoint, FLIGHT, RunFolder, Stage, StepTable, TrainConfig};

/// Seed of the flight's world; training worlds have seeds from multiples of 1,000,003 upwards.
const WORLD_SEED: u64 = 900_001;
/// Number of its photos.
const PHOTOS: usize = 16;

/// Columns of `flight.csv`.
const HEADER: &str = "step,heading_known,photos,within_5_m,within_20_m,median_m";

/// The flight, rendered when it is first needed, and its table.
pub(super) struct FlightLog {
    table: StepTable,
    /// With the folder of its map and pack, which are not results.
    flight: Option<(ValidationFlight, tempfile::TempDir)>,
}

impl FlightLog {
    /// For a run that starts or resumes at `step`; `None` if the stage does not localise, or validation is disabled.
    pub(super) fn of(config: &TrainConfig, folder: &RunFolder, step: u64) -> Result<Option<Self>> {
        // Also without validation, so that no rows of another run stay.
        let table = StepTable::open(folder, FLIGHT, HEADER, step)?;
        let is_measured = config.stage == Stage::Joint && config.validate_minutes > 0.0;
        Ok(is_measured.then_some(Self {
            table,
            flight: None,
        }))
    }

    /// Localises the flight with the averaged parameters and adds a row with and a row without known heading, unless there are rows of
    /// this step.
    pub(super) fn add(&mut self, state: &Checkpoint) -> Result<()> {
        if self.table.has_step(state.position.step) {
            return Ok(());
        }
        let (flight, _) = match &mut self.flight {
            Some(flight) => flight,
            none => {
                let scratch = tempfile::tempdir()?;
                none.insert((
                    ValidationFlight::draw(WORLD_SEED, PHOTOS, scratch.path())?,
                    scratch,
                ))
            }
        };
        let mut rows = Vec::new();
        for figures in flight.measure(&state.model()?)? {
            let median_m = figures
                .median_m
                .map_or(String::new(), |m| format!("{m:.2}"));
            rows.push(format!(
                "{},{},{},{:.3},{:.3},{median_m}",
                state.position.step,
                figures.heading_known,
                figures.photos,
                figures.within_5_m,
                figures.within_20_m,
            ));
            tracing::info!(
                "flight, heading {}: {:.0} % within 5 m, {:.0} % within 20 m",
                if figures.heading_known {
                    "known"
                } else {
                    "unknown"
                },
                100.0 * figures.within_5_m,
                100.0 * figures.within_20_m
            );
        }
        Ok(self.table.add(rows)?)
    }
}
