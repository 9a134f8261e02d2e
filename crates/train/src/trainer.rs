//! The training loop.

use crate::TrainError;
use crate::batch::input_of;
use crate::centres::start_centres;
use crate::checkpoint::Checkpoint;
use crate::config::{Stage, TrainConfig};
use crate::data::{Batch, Sources, Stream, batch_of};
use crate::first::first_state;
use crate::network::{Network, Statistics, unit_rows};
use crate::objective::{Losses, Objective, Turn};
use crate::parameters::Parameters;
use crate::schedule::{learning_rate, remaining_s, share_done};
use burn::tensor::{Device, Tensor};
use grimnet_net::Model;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// A step that took longer than this was interrupted: the rest is no training time.
const LONGEST_STEP_S: f64 = 60.0;
/// Reports come at least this often.
const LONGEST_SILENCE_S: f64 = 30.0;
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
    stop: Arc<AtomicBool>,
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
        let scenes = scenes_of(&config, &sources)?;
        let state = if resume {
            resumed(&config, scenes, device)?
        } else {
            first_state(&config, scenes, device)?
        };
        Ok(Self {
            objective: Objective::new(&config, state.parameters.spec(), device)?,
            config,
            device: device.clone().autodiff(),
            state,
            sources,
            stop: Arc::default(),
        })
    }

    /// The state as it is.
    pub fn state(&self) -> &Checkpoint {
        &self.state
    }

    /// A switch that ends [`Trainer::run`] after the step in hand, as if its time were over.
    pub fn stop_switch(&self) -> Arc<AtomicBool> {
        self.stop.clone()
    }

    /// Trains until the configured steps or minutes are over, or `go_on` says no; saves checkpoints on the way and at the end.
    ///
    /// # Errors
    /// [`TrainError::NotFinite`] where a loss is not a number; errors of files and of the device.
    pub fn run(
        &mut self,
        go_on: &mut dyn FnMut(&Progress, &Checkpoint) -> bool,
    ) -> Result<(), TrainError> {
        let config = self.config.clone();
        let path = checkpoint_path(&config);
        let mut stream = Stream::start(
            self.sources.clone(),
            config.pairs.clone(),
            config.pairs_per_step,
            config.seed,
            self.state.position.step,
            config.data_threads,
        );
        let mut last = Instant::now();
        let (mut saved, mut reported) = (Instant::now(), Instant::now());
        let (mut sum, mut count) = (Losses::default(), 0u64);
        loop {
            let done = share_done(&config, &self.state.position);
            if done >= 1.0 || self.stop.load(Ordering::Relaxed) {
                break;
            }
            let in_use = config.stage == Stage::Joint && done >= config.global_from;
            if in_use && !self.state.position.centres_started {
                self.start_centres()?;
            }
            let batch = enough(
                stream.next_batch().unwrap_or_default(),
                self.state.position.step,
            )?;
            let rate = learning_rate(&config, self.state.adam.updates, done);
            let (losses, gradient) = self.step(&batch, rate)?;
            self.state.position.step += 1;
            self.state.position.elapsed_s += last.elapsed().as_secs_f64().min(LONGEST_STEP_S);
            last = Instant::now();
            sum.add(&losses);
            count += 1;
            if saved.elapsed().as_secs_f64() > config.checkpoint_minutes * 60.0 {
                self.state.save(&path)?;
                saved = Instant::now();
            }
            if count == config.report_steps || reported.elapsed().as_secs_f64() > LONGEST_SILENCE_S
            {
                let n = count as f32;
                let progress = Progress {
                    step: self.state.position.step,
                    elapsed_s: self.state.position.elapsed_s,
                    remaining_s: remaining_s(&config, &self.state.position),
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
        let input = input_of(batch, tracked.spec(), self.config.norms, &self.device);
        let turn = Turn::of(
            config,
            self.state.position.step,
            self.state.position.centres_started,
        );
        let mut network = Network::new(&tracked, Statistics::Batch);
        let (total, losses) = self.objective.of(&mut network, &input, batch, turn)?;
        let running = network.into_running();
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
            let batch = enough(batch, self.state.position.step)?;
            let input = input_of(
                &batch,
                self.state.parameters.spec(),
                self.config.norms,
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

/// Number of scenes to tell apart.
fn scenes_of(config: &TrainConfig, sources: &Sources) -> Result<usize, TrainError> {
    if config.stage != Stage::Scenes {
        return Ok(0);
    }
    let counts = sources.iter().map(|(_, source)| source.scenes());
    match counts.max() {
        Some(count) if count > 1 => Ok(count),
        _ => Err(TrainError::Config {
            reason: "`stage = \"scenes\"` needs `[[data]]` of `layout = \"classes\"`".into(),
        }),
    }
}

/// The state that a run goes on from.
fn resumed(config: &TrainConfig, scenes: usize, device: &Device) -> Result<Checkpoint, TrainError> {
    let path = checkpoint_path(config);
    let state = Checkpoint::open(&path, device)?;
    let wanted = Parameters::of_model(&Model::random(&config.spec()?, 0)?, device);
    let other = |reason: String| Err(TrainError::Checkpoint { path, reason });
    if state.parameters.spec() != wanted.spec() {
        let network = &config.network;
        return other(format!(
            "it holds another network than `{network}`; train into another folder"
        ));
    }
    let (theirs, ours) = (state.position.stage, config.stage);
    if theirs != ours {
        return other(format!(
            "it is of the stage `{theirs}`, not `{ours}`; give each stage its own `out`, and name this file as the next one's `start_from`"
        ));
    }
    let known = state.parameters.scenes();
    if known != scenes {
        return other(format!(
            "it tells {known} scenes apart, and the data have {scenes}; begin anew, or give the data it began with"
        ));
    }
    Ok(state)
}

/// A batch that a step can be made of.
pub(crate) fn enough(batch: Batch, step: u64) -> Result<Batch, TrainError> {
    if batch.len() < 2 {
        return Err(TrainError::NoPairs { step });
    }
    Ok(batch)
}

/// Where the checkpoint of a run is.
pub fn checkpoint_path(config: &TrainConfig) -> PathBuf {
    config.out.join("checkpoint.safetensors")
}
