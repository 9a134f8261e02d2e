//! How far a training run has come in metres: a procedural flight, localised now and then, a line in `flight.csv` each time.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use grimnet_experiments::training_flight::Flight;
use grimnet_net::Card;
use grimnet_train::{Checkpoint, Stage, TrainConfig};

/// The flight's world: training draws few worlds, from multiples of 1,000,003 upwards.
const WORLD_SEED: u64 = 900_001;
/// Its photos.
const PHOTOS: usize = 16;

/// The flight, drawn when it is first needed, and where it and its figures go.
pub(super) struct FlightLog {
    out: PathBuf,
    flight: Option<Flight>,
}

impl FlightLog {
    /// None where the run does not localise yet, or is not to be measured.
    pub(super) fn of(config: &TrainConfig) -> Option<Self> {
        let is_measured = config.stage == Stage::Joint && config.validate_minutes > 0.0;
        is_measured.then(|| Self {
            out: config.out.clone(),
            flight: None,
        })
    }

    /// Localises the flight with the averaged parameters and adds a line for each heading mode.
    pub(super) fn add(&mut self, state: &Checkpoint) -> Result<()> {
        let flight = match &mut self.flight {
            Some(flight) => flight,
            none => none.insert(Flight::draw(WORLD_SEED, PHOTOS, &self.out.join("flight"))?),
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
