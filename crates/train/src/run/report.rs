//! Reports of a run.

use crate::config::TrainConfig;
use crate::run::checkpoint::Position;
use crate::run::losses::{LossSums, Losses};
use crate::run::schedule::remaining_s;
use std::time::Instant;

/// Longest time between reports.
const LONGEST_SILENCE_S: f64 = 30.0;

/// A progress report.
#[derive(Clone, Debug)]
pub struct Progress {
    /// Number of steps done.
    pub step: u64,
    /// Training time including earlier runs, seconds.
    pub elapsed_s: f64,
    /// Estimated remaining time, seconds.
    pub remaining_s: f64,
    /// Mean of each loss over the steps since the last report that computed it.
    pub losses: Losses,
    /// Pairs per second since the last report.
    pub pairs_per_s: f64,
    /// Learning rate.
    pub learning_rate: f64,
    /// Norm of the last gradient before clipping.
    pub gradient: f32,
}

/// What is collected between two reports.
pub(crate) struct Report {
    losses: LossSums,
    steps: u64,
    since: Instant,
    gradient: f32,
    learning_rate: f64,
}

impl Report {
    pub(crate) fn new() -> Self {
        Self {
            losses: LossSums::default(),
            steps: 0,
            since: Instant::now(),
            gradient: 0.0,
            learning_rate: 0.0,
        }
    }

    pub(crate) fn add(&mut self, losses: &Losses, gradient: f32, learning_rate: f64) {
        self.losses.add(losses);
        self.steps += 1;
        self.gradient = gradient;
        self.learning_rate = learning_rate;
    }

    /// Whether there were no steps since the last report.
    pub(crate) fn is_empty(&self) -> bool {
        self.steps == 0
    }

    pub(crate) fn is_due(&self, config: &TrainConfig) -> bool {
        self.steps == config.report_steps || self.since.elapsed().as_secs_f64() > LONGEST_SILENCE_S
    }

    /// The report.
    pub(crate) fn progress(&self, config: &TrainConfig, position: &Position) -> Progress {
        Progress {
            step: position.step,
            elapsed_s: position.elapsed_s,
            remaining_s: remaining_s(config, position),
            losses: self.losses.mean(),
            pairs_per_s: (self.steps * config.pairs_per_step as u64) as f64
                / self.since.elapsed().as_secs_f64(),
            learning_rate: self.learning_rate,
            gradient: self.gradient,
        }
    }
}
