//! The training loop.

use crate::TrainError;
use crate::batch::input_of;
use crate::centres::start_centres;
use crate::checkpoint::{Checkpoint, Position};
use crate::config::TrainConfig;
use crate::data::{Batch, Pictures, Sources, Stream, batch_of};
use crate::network::{Network, Statistics, unit_rows};
use crate::objective::{Losses, Objective, Turn};
use crate::optimiser::Adam;
use crate::parameters::Parameters;
use burn::tensor::{Device, Tensor};
use grimnet_net::Model;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Batches whose descriptors NetVLAD's clusters are taken from.
const CENTRE_BATCHES: u64 = 4;

/// How a run is going.
#[derive(Clone, Debug)]
pub struct Progress {
    /// Steps made.
    pub step: u64,
    /// Seconds of training, earlier runs included.
    pub elapsed_s: f64,
    /// Seconds left.
    pub remaining_s: f64,
    /// Mean losses since the last report.
    pub losses: Losses,
    /// Pairs per second since the last report.
    pub pairs_per_s: f64,
    /// Learning rate.
    pub learning_rate: f64,
    /// Length of the last gradient, before clipping.
    pub gradient: f32,
}

/// What a trainer holds between steps.
pub struct Trainer {
    config: TrainConfig,
    device: Device,
    state: Checkpoint,
    objective: Objective,
    sources: Sources,
}

impl Trainer {
    /// A new run, or with `resume` the run that `out/checkpoint.safetensors` holds.
    ///
    /// # Errors
    /// A wrong configuration, too few pictures, a checkpoint that is damaged or of another network.
    pub fn new(
        config: TrainConfig,
        sources: Sources,
        device: &Device,
        resume: bool,
    ) -> Result<Self, TrainError> {
        config.validate()?;
        let path = checkpoint_path(&config);
        let state = if resume {
            let state = Checkpoint::open(&path, device)?;
            let wanted = Parameters::of_model(&Model::random(&config.spec()?, 0)?, device);
            if state.parameters.spec() != wanted.spec() {
                return Err(TrainError::Checkpoint {
                    path,
                    reason: format!(
                        "it holds another network than `{}`; train into another folder",
                        config.network
                    ),
                });
            }
            state
        } else {
            let parameters =
                Parameters::of_model(&Model::random(&config.spec()?, config.seed)?, device);
            Checkpoint {
                average: parameters.clone(),
                parameters,
                adam: Adam::default(),
                position: Position::default(),
            }
        };
        Ok(Self {
            objective: Objective::new(&config, state.parameters.spec(), device)?,
            config,
            device: device.clone().autodiff(),
            state,
            sources,
        })
    }

    /// The state as it is.
    pub fn state(&self) -> &Checkpoint {
        &self.state
    }

    /// Trains until the configured minutes are over, or `go_on` says no; saves checkpoints on the way and at the end.
    ///
    /// # Errors
    /// [`TrainError::NotFinite`] where a loss is not a number; errors of files and of the device.
    pub fn run(
        &mut self,
        go_on: &mut dyn FnMut(&Progress, &Checkpoint) -> bool,
    ) -> Result<(), TrainError> {
        let config = self.config.clone();
        let total_s = config.minutes * 60.0;
        let path = checkpoint_path(&config);
        let mut stream = Stream::start(
            self.sources.clone(),
            config.pairs.clone(),
            config.pairs_per_step,
            config.seed,
            self.state.position.step,
            config.data_threads,
        );
        let before_s = self.state.position.elapsed_s;
        let started = Instant::now();
        let (mut saved, mut reported) = (Instant::now(), Instant::now());
        let (mut sum, mut count) = (Losses::default(), 0u64);
        while self.state.position.elapsed_s < total_s {
            let done = self.state.position.elapsed_s / total_s;
            if !self.state.position.centres_started && done >= config.global_from {
                self.start_centres()?;
            }
            let Some(batch) = stream.next_batch() else {
                return Err(TrainError::Config {
                    reason: "the threads that make pairs have stopped".into(),
                });
            };
            let rate = learning_rate(&config, self.state.adam.updates, done);
            let (losses, gradient) = self.step(&batch, rate)?;
            self.state.position.step += 1;
            self.state.position.elapsed_s = before_s + started.elapsed().as_secs_f64();
            sum.add(&losses);
            count += 1;
            if saved.elapsed().as_secs_f64() > config.checkpoint_minutes * 60.0 {
                self.state.save(&path)?;
                saved = Instant::now();
            }
            if count == config.report_steps {
                let n = count as f32;
                let progress = Progress {
                    step: self.state.position.step,
                    elapsed_s: self.state.position.elapsed_s,
                    remaining_s: (total_s - self.state.position.elapsed_s).max(0.0),
                    losses: sum.scaled(1.0 / n),
                    pairs_per_s: (count * config.pairs_per_step as u64) as f64
                        / reported.elapsed().as_secs_f64(),
                    learning_rate: rate,
                    gradient,
                };
                (sum, count, reported) = (Losses::default(), 0, Instant::now());
                if !go_on(&progress, &self.state) {
                    break;
                }
            }
        }
        self.state.save(&path)
    }

    /// One optimisation step.
    fn step(&mut self, batch: &Batch, rate: f64) -> Result<(Losses, f32), TrainError> {
        let config = &self.config;
        let tracked = self.state.parameters.tracked();
        let input = input_of(batch, tracked.spec(), &self.device);
        let turn = Turn::of(
            config,
            self.state.position.step,
            self.state.position.centres_started,
        );
        let mut network = Network::new(&tracked, Statistics::Batch);
        let output = network.forward(&input, turn.retrieval)?;
        let running = network.into_running();
        let (total, losses) = self.objective.of(output, batch, turn)?;
        let mut gradients = total.backward();
        let encoder = (rate * config.encoder_rate) as f32;
        let length = self.state.adam.step(
            &mut self.state.parameters,
            &tracked,
            &mut gradients,
            config.clip,
            |name| {
                if name.starts_with("encoder.") {
                    encoder
                } else {
                    rate as f32
                }
            },
        )?;
        let values = losses.terms().map(|(name, value)| (name, value));
        for (what, value) in values.into_iter().chain([("gradient", length)]) {
            if !value.is_finite() {
                return Err(TrainError::NotFinite {
                    step: self.state.position.step,
                    what: format!("the {what}"),
                    checkpoint: checkpoint_path(config).display().to_string(),
                });
            }
        }
        for (name, value) in running {
            self.state.parameters.set(&name, value)?;
        }
        self.follow()?;
        Ok((losses, length))
    }

    /// The running average follows the parameters; quickly at first.
    fn follow(&mut self) -> Result<(), TrainError> {
        let updates = self.state.adam.updates as f32;
        let keep = self
            .config
            .average_decay
            .min((1.0 + updates) / (10.0 + updates));
        for name in self.state.parameters.names() {
            let new = self.state.parameters.flat(&name)?;
            let old = self.state.average.flat(&name)?;
            self.state
                .average
                .set(&name, old.mul_scalar(keep) + new.mul_scalar(1.0 - keep))?;
        }
        Ok(())
    }

    /// Starts NetVLAD from clusters of the map side's vectors.
    fn start_centres(&mut self) -> Result<(), TrainError> {
        let mut all = Vec::new();
        for i in 0..CENTRE_BATCHES {
            let batch = batch_of(
                &self.sources,
                &self.config.pairs,
                self.config.pairs_per_step,
                self.config.seed ^ 0xc1u64,
                i,
            );
            let input = input_of(
                &batch,
                self.state.parameters.spec(),
                &self.device.clone().without_autodiff(),
            );
            let output =
                Network::new(&self.state.parameters, Statistics::Batch).forward(&input, false)?;
            let [_, h, w, d] = output.aggregated.dims();
            all.push(unit_rows(
                output
                    .aggregated
                    .narrow(0, 0, batch.len())
                    .reshape([batch.len() * h * w, d]),
            ));
        }
        start_centres(
            &mut self.state.parameters,
            Tensor::cat(all, 0),
            self.config.seed,
        )?;
        for name in [
            "netvlad.assign.weight",
            "netvlad.assign.bias",
            "netvlad.centres",
        ] {
            self.state
                .average
                .set(name, self.state.parameters.flat(name)?)?;
        }
        self.state.position.centres_started = true;
        tracing::info!("NetVLAD starts from clusters of what it aggregates");
        Ok(())
    }
}

/// Where the checkpoint of a run is.
pub fn checkpoint_path(config: &TrainConfig) -> PathBuf {
    config.out.join("checkpoint.safetensors")
}

/// Rises over the warm-up, stays, falls along a cosine.
fn learning_rate(config: &TrainConfig, updates: u64, done: f64) -> f64 {
    let rise = ((updates + 1) as f64 / config.warmup_steps.max(1) as f64).min(1.0);
    let fall = if done > config.decay_from && config.decay_from < 1.0 {
        let t = ((done - config.decay_from) / (1.0 - config.decay_from)).min(1.0);
        0.5 + 0.5 * (std::f64::consts::PI * t).cos()
    } else {
        1.0
    };
    config.learning_rate * (rise * fall).max(1e-3)
}

/// Sources of a configuration: its pictures.
///
/// # Errors
/// Folders that cannot be read, too few pictures.
pub fn sources_of(config: &TrainConfig) -> Result<(Sources, Arc<Pictures>), TrainError> {
    let pictures = Arc::new(Pictures::scan(&config.data, config.pairs.side_px * 3 / 4)?);
    tracing::info!(
        pictures = pictures.training_count(),
        unreadable = pictures.unreadable(),
        "pictures to train on"
    );
    Ok((vec![(1.0, pictures.clone())], pictures))
}
