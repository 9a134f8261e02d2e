//! Measuring now and then, while training goes on, on what was kept aside.

use crate::TrainError;
use crate::batch::Norms;
use crate::checkpoint::Checkpoint;
use crate::config::{Stage, TrainConfig};
use crate::data::{Data, Pair};
use crate::scene_accuracy::{SceneAccuracy, scene_accuracy};
use crate::validation::{Sight, Validation, pairs_of, validation_options};
use grimnet_net::{Card, Model};
use std::fmt;
use std::path::PathBuf;
use std::time::Instant;

/// Pairs measured of each of the things kept aside.
const PAIRS: usize = 48;
/// Pairs for the share of scenes that are told right, which is cheap to measure.
const SCENE_PAIRS: usize = 240;

/// What is measured, by the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Figures {
    /// Of keypoints, descriptors and places.
    Places(Validation),
    /// Of scene classes.
    Scenes(SceneAccuracy),
}

impl Figures {
    /// Columns of `validation.csv` after the step and the name.
    fn header(stage: Stage) -> &'static str {
        match stage {
            Stage::Scenes => "pairs,scene_accuracy",
            Stage::Joint | Stage::Shapes => {
                "pairs,repeatability,matching_score,match_precision,within_1_px,within_3_px,within_5_px,recall_1,recall_5,gallery"
            }
        }
    }

    fn row(&self) -> String {
        match self {
            Self::Scenes(v) => format!("{},{:.4}", v.views / 2, v.share),
            Self::Places(v) => {
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
                format!("{},{shares},{}", v.pairs, v.gallery)
            }
        }
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| (share * 100.0).round();
        match self {
            Self::Scenes(v) => write!(
                f,
                "{} % of {} views are given their scene",
                percent(v.share),
                v.views
            ),
            Self::Places(v) => write!(
                f,
                "repeatability {} %, matching score {} %, homography within 3 px {} %, place first {} %",
                percent(v.repeatability),
                percent(v.matching_score),
                percent(v.homography_accuracy[1]),
                percent(v.recall[0])
            ),
        }
    }
}

/// Measures a run every `validate_minutes`, and keeps the figures in `validation.csv`.
pub struct Validator {
    path: PathBuf,
    stage: Stage,
    norms: Norms,
    minutes: f64,
    held: Vec<(&'static str, Vec<Pair>)>,
    last: Instant,
}

impl Validator {
    /// Draws the pairs, the same for every run. With `validate_minutes = 0` there are none.
    pub fn new(config: &TrainConfig, data: &Data) -> Self {
        let (views, count) = match config.stage {
            Stage::Scenes => (config.pairs.clone(), SCENE_PAIRS),
            Stage::Joint | Stage::Shapes => (validation_options(&config.pairs), PAIRS),
        };
        let aside = data.aside.iter().filter(|_| config.validate_minutes > 0.0);
        Self {
            path: config.out.join("validation.csv"),
            stage: config.stage,
            norms: config.norms,
            minutes: config.validate_minutes,
            held: aside
                .map(|(name, source)| (*name, pairs_of(source.as_ref(), count, &views, 17)))
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
    ) -> Result<Option<Vec<(String, Figures)>>, TrainError> {
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
    pub fn measure(&self, state: &Checkpoint) -> Result<Vec<(String, Figures)>, TrainError> {
        let mut text = match fs_err::read_to_string(&self.path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                format!("step,aside,{}\n", Figures::header(self.stage))
            }
            Err(error) => return Err(error.into()),
        };
        let model = state.average.to_model(Card::default())?;
        let mut out = Vec::new();
        for (name, pairs) in &self.held {
            let figures = self.figures(state, &model, pairs)?;
            text.push_str(&format!(
                "{},{name},{}\n",
                state.position.step,
                figures.row()
            ));
            out.push(((*name).to_owned(), figures));
        }
        if let Some(folder) = self.path.parent() {
            fs_err::create_dir_all(folder)?;
        }
        fs_err::write(&self.path, text)?;
        Ok(out)
    }

    fn figures(
        &self,
        state: &Checkpoint,
        model: &Model,
        pairs: &[Pair],
    ) -> Result<Figures, TrainError> {
        Ok(match self.stage {
            Stage::Scenes => Figures::Scenes(scene_accuracy(&state.average, pairs, self.norms)?),
            Stage::Joint | Stage::Shapes => {
                Figures::Places(Sight::of(model, pairs, &mut || ())?.validation(pairs, &[]))
            }
        })
    }
}
