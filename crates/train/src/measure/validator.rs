//! Validation at intervals during training.

use crate::config::{Stage, TrainConfig};
use crate::data::Pair;
use crate::error::TrainError;
use crate::measure::scene_accuracy::{SceneAccuracy, scene_accuracy};
use crate::measure::validation::{PairOutputs, Validation, pairs_of, validation_options};
use crate::run::checkpoint::Checkpoint;
use crate::run::data::Data;
use crate::run::run_folder::{RunFolder, VALIDATION};
use crate::run::step_table::StepTable;
use grimnet_net::Model;
use std::fmt;
use std::time::Instant;

/// Pairs of each held-out source.
const PAIRS: usize = 48;
/// Pairs for the accuracy of scene classes, which is cheap to measure.
const SCENE_PAIRS: usize = 240;

/// The figures of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Figures {
    /// Keypoints, descriptors and retrieval.
    Places(Validation),
    /// Scene classes.
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
                let matching = v.matching.map_or([const { String::new() }; 6], |m| {
                    let [one, three, five] = m.homography_accuracy;
                    [
                        m.repeatability,
                        m.matching_score,
                        m.match_precision,
                        one,
                        three,
                        five,
                    ]
                    .map(|share| format!("{share:.4}"))
                });
                let [first, fifth] = v.recall;
                let matching = matching.join(",");
                format!("{},{matching},{first:.4},{fifth:.4},{}", v.pairs, v.gallery)
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
                "{} % of {} views classified correctly",
                percent(v.share),
                v.views
            ),
            Self::Places(v) => {
                if let Some(m) = &v.matching {
                    write!(
                        f,
                        "repeatability {} %, matching score {} %, homography within 3 px {} %, ",
                        percent(m.repeatability),
                        percent(m.matching_score),
                        percent(m.homography_accuracy[1])
                    )?;
                }
                write!(f, "recall@1 {} %", percent(v.recall[0]))
            }
        }
    }
}

/// Measures a run every `validate_minutes` and appends the figures to `validation.csv`.
pub struct Validator {
    table: StepTable,
    stage: Stage,
    minutes: f64,
    held: Vec<(&'static str, Vec<Pair>)>,
    last: Instant,
}

impl Validator {
    /// Draws the pairs; none if `validate_minutes` is 0. Those of pictures are the same for every run, those of procedural worlds for
    /// every run with the same `seed`. The run starts or resumes at `step`.
    ///
    /// # Errors
    /// As [`StepTable::open`].
    pub fn new(
        config: &TrainConfig,
        data: &Data,
        folder: &RunFolder,
        step: u64,
    ) -> Result<Self, TrainError> {
        let (views, count) = match config.stage {
            Stage::Scenes => (config.pairs.clone(), SCENE_PAIRS),
            Stage::Joint | Stage::Shapes => (validation_options(&config.pairs), PAIRS),
        };
        let held_out = data
            .held_out
            .iter()
            .filter(|_| config.validate_minutes > 0.0);
        let header = format!("step,held_out,{}", Figures::header(config.stage));
        Ok(Self {
            table: StepTable::open(folder, VALIDATION, &header, step)?,
            stage: config.stage,
            minutes: config.validate_minutes,
            held: held_out
                .map(|(name, source)| (*name, pairs_of(source.as_ref(), count, &views, 17)))
                .collect(),
            last: Instant::now(),
        })
    }

    /// Measures the averaged parameters if `validate_minutes` have passed. Nothing to measure on, as where no picture is held out, gives
    /// no figures, and not `None`.
    ///
    /// # Errors
    /// Returns an error if values cannot be read from the device, or the file cannot be written.
    pub fn measure_if_due(
        &mut self,
        state: &Checkpoint,
    ) -> Result<Option<Vec<(String, Figures)>>, TrainError> {
        if self.minutes == 0.0 || self.last.elapsed().as_secs_f64() < self.minutes * 60.0 {
            return Ok(None);
        }
        let found = self.measure(state)?;
        self.last = Instant::now();
        Ok(Some(found))
    }

    /// Measures the averaged parameters at the end of a run, likewise, unless there are rows of this step.
    ///
    /// # Errors
    /// As [`Validator::measure_if_due`].
    pub fn measure_at_end(
        &mut self,
        state: &Checkpoint,
    ) -> Result<Option<Vec<(String, Figures)>>, TrainError> {
        if self.minutes == 0.0 || self.table.has_step(state.position.step) {
            return Ok(None);
        }
        self.measure(state).map(Some)
    }

    /// Measures the averaged parameters and adds a row for each held-out source.
    ///
    /// # Errors
    /// As [`Validator::measure_if_due`].
    pub fn measure(&mut self, state: &Checkpoint) -> Result<Vec<(String, Figures)>, TrainError> {
        let model = state.model()?;
        let (mut rows, mut out) = (Vec::new(), Vec::new());
        for (name, pairs) in &self.held {
            let figures = self.figures(state, &model, pairs)?;
            rows.push(format!("{},{name},{}", state.position.step, figures.row()));
            out.push(((*name).to_owned(), figures));
        }
        self.table.add(rows)?;
        Ok(out)
    }

    fn figures(
        &self,
        state: &Checkpoint,
        model: &Model,
        pairs: &[Pair],
    ) -> Result<Figures, TrainError> {
        Ok(match self.stage {
            Stage::Scenes => Figures::Scenes(scene_accuracy(&state.average, pairs, state.norms())?),
            Stage::Joint | Stage::Shapes => {
                Figures::Places(PairOutputs::of(model, pairs, &mut || ())?.validation(pairs, &[]))
            }
        })
    }
}
