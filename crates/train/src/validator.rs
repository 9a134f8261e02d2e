//! Measuring now and then, while training goes on, on what was kept aside.

use crate::TrainError;
use crate::checkpoint::Checkpoint;
use crate::config::TrainConfig;
use crate::data::{Data, Pair};
use crate::validation::{Validations, pairs_of, validate, validation_options};
use grimnet_net::Card;
use std::path::PathBuf;
use std::time::Instant;

/// Pairs measured of each of the things kept aside.
const PAIRS: usize = 48;
const HEADER: &str = "step,aside,pairs,repeatability,matching_score,match_precision,within_1_px,within_3_px,within_5_px,recall_1,recall_5,gallery";

/// Measures a run every `validate_minutes`, and keeps the figures in `validation.csv`.
pub struct Validator {
    path: PathBuf,
    minutes: f64,
    held: Vec<(&'static str, Vec<Pair>)>,
    last: Instant,
}

impl Validator {
    /// Draws the pairs, the same for every run. With `validate_minutes = 0` there are none.
    pub fn new(config: &TrainConfig, data: &Data) -> Self {
        let views = validation_options(&config.pairs);
        let aside = data.aside.iter().filter(|_| config.validate_minutes > 0.0);
        Self {
            path: config.out.join("validation.csv"),
            minutes: config.validate_minutes,
            held: aside
                .map(|(name, source)| (*name, pairs_of(source.as_ref(), PAIRS, &views, 17)))
                .collect(),
            last: Instant::now(),
        }
    }

    /// Measures the averaged parameters, if it is time.
    ///
    /// # Errors
    /// Where the device does not give values back, or the file cannot be written.
    pub fn measure_if_due(
        &mut self,
        state: &Checkpoint,
    ) -> Result<Option<Validations>, TrainError> {
        if self.held.is_empty() || self.last.elapsed().as_secs_f64() < self.minutes * 60.0 {
            return Ok(None);
        }
        let found = self.measure(state)?;
        self.last = Instant::now();
        Ok(Some(found))
    }

    /// Measures the averaged parameters and adds a line for each thing kept aside.
    ///
    /// # Errors
    /// As [`Validator::measure_if_due`].
    pub fn measure(&self, state: &Checkpoint) -> Result<Validations, TrainError> {
        let model = state.average.to_model(Card::default())?;
        let mut text = match fs_err::read_to_string(&self.path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => format!("{HEADER}\n"),
            Err(error) => return Err(error.into()),
        };
        let mut out = Vec::new();
        for (name, pairs) in &self.held {
            let v = validate(&model, pairs, &[])?;
            let [one, three, five] = v.homography_accuracy;
            let shares = [
                v.repeatability,
                v.matching_score,
                v.match_precision,
                one,
                three,
                five,
                v.recall[0],
                v.recall[1],
            ];
            let shares = shares.map(|share| format!("{share:.4}")).join(",");
            text.push_str(&format!(
                "{},{name},{},{shares},{}\n",
                state.position.step, v.pairs, v.gallery
            ));
            out.push(((*name).to_owned(), v));
        }
        if let Some(folder) = self.path.parent() {
            fs_err::create_dir_all(folder)?;
        }
        fs_err::write(&self.path, text)?;
        Ok(out)
    }
}
