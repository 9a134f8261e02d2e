//! Localisation accuracy during training: a procedural flight, localised at each validation, with a row in `flight.csv`.

use std::fmt::Write as _;

use anyhow::Result;
use grimnet_eval::validation_flight::ValidationFlight;
use grimnet_net::Card;
use grimnet_train::{Checkpoint, FLIGHT, RunFolder, Stage, TrainConfig};

/// Seed of the flight's world; training worlds have seeds from multiples of 1,000,003 upwards.
const WORLD_SEED: u64 = 900_001;
/// Number of its photos.
const PHOTOS: usize = 16;

/// The flight, rendered when it is first needed, and the output folder.
pub(super) struct FlightLog {
    folder: RunFolder,
    /// With the folder of its map and pack, which are not results.
    flight: Option<(ValidationFlight, tempfile::TempDir)>,
}

impl FlightLog {
    /// `None` if the stage does not localise, or validation is disabled.
    pub(super) fn of(config: &TrainConfig, folder: &RunFolder) -> Option<Self> {
        let is_measured = config.stage == Stage::Joint && config.validate_minutes > 0.0;
        is_measured.then(|| Self {
            folder: folder.clone(),
            flight: None,
        })
    }

    /// Localises the flight with the averaged parameters and adds a row with and a row without known heading.
    pub(super) fn add(&mut self, state: &Checkpoint) -> Result<()> {
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
        let model = state.average.to_model(Card::default())?;
        let path = self.folder.path().join(FLIGHT);
        let mut table = if path.exists() {
            fs_err::read_to_string(path)?
        } else {
            "step,heading_known,photos,within_5_m,within_20_m,median_m\n".to_owned()
        };
        for figures in flight.measure(&model)? {
            let median_m = figures
                .median_m
                .map_or(String::new(), |m| format!("{m:.2}"));
            writeln!(
                table,
                "{},{},{},{:.3},{:.3},{median_m}",
                state.position.step,
                figures.heading_known,
                figures.photos,
                figures.within_5_m,
                figures.within_20_m,
            )?;
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
        Ok(self.folder.write(FLIGHT, table.as_bytes())?)
    }
}
