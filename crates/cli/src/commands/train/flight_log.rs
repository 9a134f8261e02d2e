//! Localisation accuracy during training: a procedural flight, localised at each validation, with a row in `flight.csv`.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use grimnet_eval::validation_flight::ValidationFlight;
use grimnet_net::Card;
use grimnet_train::{Checkpoint, Stage, TrainConfig};

/// Seed of the flight's world; training worlds have seeds from multiples of 1,000,003 upwards.
const WORLD_SEED: u64 = 900_001;
/// Number of its photos.
const PHOTOS: usize = 16;

/// The flight, rendered when it is first needed, and the output folder.
pub(super) struct FlightLog {
    out: PathBuf,
    flight: Option<ValidationFlight>,
}

impl FlightLog {
    /// `None` if the stage does not localise, or validation is disabled.
    pub(super) fn of(config: &TrainConfig) -> Option<Self> {
        let is_measured = config.stage == Stage::Joint && config.validate_minutes > 0.0;
        is_measured.then(|| Self {
            out: config.out.clone(),
            flight: None,
        })
    }

    /// Localises the flight with the averaged parameters and adds a row with and a row without known heading.
    pub(super) fn add(&mut self, state: &Checkpoint) -> Result<()> {
        let flight = match &mut self.flight {
            Some(flight) => flight,
            none => none.insert(ValidationFlight::draw(
                WORLD_SEED,
                PHOTOS,
                &self.out.join("flight"),
            )?),
        };
        let model = state.average.to_model(Card::default())?;
        let mut file = fs_err::OpenOptions::new()
            .create(true)
            .append(true)
            .open(self.out.join("flight.csv"))?;
        if file.metadata()?.len() == 0 {
            writeln!(
                file,
                "step,heading_known,photos,within_5_m,within_20_m,median_m"
            )?;
        }
        for figures in flight.measure(&model)? {
            let median_m = figures
                .median_m
                .map_or(String::new(), |m| format!("{m:.2}"));
            writeln!(
                file,
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
        Ok(())
    }
}
