//! The training loop.

use crate::config::{Stage, TrainConfig};
use crate::data::{Batch, BatchOptions, Sources, Stream, Task, batch_of, usable};
use crate::error::TrainError;
use crate::model::identity_norm::set_identity_norms;
use crate::model::input::{Norms, input_of};
use crate::model::netvlad_init::init_netvlad;
use crate::model::network::Network;
use crate::model::normalisation::Statistics;
use crate::model::parameters::Parameters;
use crate::model::vlad::unit_rows;
use crate::run::checkpoint::{CHECKPOINT, Checkpoint};
use crate::run::losses::Losses;
use crate::run::objective::{Objective, Tasks};
use crate::run::optimiser::StepOptions;
use crate::run::report::{Progress, Report};
use crate::run::resume::{checkpoint_path, last_checkpoint, scenes_of};
use crate::run::run_folder::RunFolder;
use crate::run::schedule::{learning_rate, share_done};
use crate::run::start::initial_state;
use burn::tensor::{Device, Tensor};
use grimnet_output::OutputPolicy;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// A step counts for at most this time; the process was suspended if it took longer.
const LONGEST_STEP_S: f64 = 60.0;
/// Pairs that the normalisations of weights without normalisation are computed from, and the change of the run's seed for them.
const IDENTITY_PAIRS: usize = 8;
const IDENTITY_SEED: u64 = 0x1d;
/// Batches that NetVLAD is initialised from.
const CENTRE_BATCHES: u64 = 4;

/// A training run.
pub struct Trainer {
    config: TrainConfig,
    device: Device,
    state: Checkpoint,
    objective: Objective,
    sources: Sources,
    stop: Arc<AtomicBool>,
    /// Opened by [`Trainer::run`] if it is not given.
    folder: Option<RunFolder>,
    /// Whether the checkpoint in the folder is of this run.
    has_checkpoint: bool,
}

impl Trainer {
    /// A new run, or with `resume` the run of `out/checkpoint.safetensors`.
    ///
    /// # Errors
    /// Returns an error if the configuration is invalid, or the checkpoint or the initial weights cannot be used.
    pub fn new(
        config: TrainConfig,
        sources: Sources,
        device: &Device,
        resume: bool,
    ) -> Result<Self, TrainError> {
        config.validate()?;
        let state = if resume {
            last_checkpoint(&config, &sources, device)?
        } else {
            let scenes = scenes_of(&config, &sources)?;
            let initial = initial_state(&config, scenes, device)?;
            if initial.lacks_norms {
                with_identity_norms(initial.checkpoint, &config, &sources, device)?
            } else {
                initial.checkpoint
            }
        };
        Ok(Self {
            objective: Objective::new(&config, state.parameters.spec(), device)?,
            config,
            device: device.clone().autodiff(),
            state,
            sources,
            stop: Arc::default(),
            folder: None,
            has_checkpoint: resume,
        })
    }

    /// Writes checkpoints into this folder, which the caller writes into as well. Without it, [`Trainer::run`] opens the folder of the
    /// configuration, where only files of earlier runs may be replaced, and no checkpoint of another run.
    #[must_use]
    pub fn with_folder(mut self, folder: RunFolder) -> Self {
        self.folder = Some(folder);
        self
    }

    /// The current state.
    pub fn state(&self) -> &Checkpoint {
        &self.state
    }

    /// A flag that ends [`Trainer::run`] after the current step when set.
    pub fn stop_switch(&self) -> Arc<AtomicBool> {
        self.stop.clone()
    }

    /// Trains until the configured steps or minutes are over, the stop switch is set, or `on_report` returns `false`. Saves a
    /// checkpoint at intervals and at the end, where the steps since the last report are reported, too.
    ///
    /// # Errors
    /// [`TrainError::EarlierRun`] if the folder was not given and holds another run; [`TrainError::NotFinite`] if a loss or gradient is not
    /// finite; errors of files and of the device.
    pub fn run(
        &mut self,
        on_report: &mut dyn FnMut(&Progress, &Checkpoint) -> bool,
    ) -> Result<(), TrainError> {
        let config = self.config.clone();
        let folder = match &self.folder {
            Some(folder) => folder.clone(),
            None => {
                let folder = RunFolder::open(&config, &OutputPolicy::new())?;
                if !self.has_checkpoint {
                    folder.check_for_new_run()?;
                }
                folder
            }
        };
        if !self.has_checkpoint {
            // From now on this is the run in the folder: a checkpoint of the run before would be resumed in its place. There is nothing
            // trained in it that an error could name.
            folder.write(CHECKPOINT, &self.state.to_bytes()?)?;
        }
        let batches = BatchOptions {
            pair: config.pairs.clone(),
            pairs: config.pairs_per_step,
            seed: config.seed,
            alternate: config.alternate && config.stage == Stage::Joint,
        };
        let mut stream = Stream::start(
            self.sources.clone(),
            batches,
            self.state.position.step,
            config.data_threads,
        );
        let mut last = Instant::now();
        let mut saved = Instant::now();
        let mut report = Report::new();
        loop {
            let done = share_done(&config, &self.state.position);
            if done >= 1.0 || self.stop.load(Ordering::Relaxed) {
                break;
            }
            let in_use = config.stage == Stage::Joint && done >= config.global_from;
            if in_use && !self.state.position.centres_started {
                self.init_netvlad()?;
            }
            let batch = usable(
                stream.next_batch().unwrap_or_default(),
                self.state.position.step,
            )?;
            let rate = learning_rate(&config, self.state.adam.updates, done);
            let (losses, gradient) = self.step(&batch, rate)?;
            self.state.position.step += 1;
            self.state.position.elapsed_s += last.elapsed().as_secs_f64().min(LONGEST_STEP_S);
            last = Instant::now();
            report.add(&losses, gradient, rate);
            if saved.elapsed().as_secs_f64() > config.checkpoint_minutes * 60.0 {
                self.save(&folder)?;
                saved = Instant::now();
            }
            if report.is_due(&config) {
                let progress = report.progress(&config, &self.state.position);
                let goes_on = on_report(&progress, &self.state);
                // Validations, which callers make in it, are no time of the next steps.
                report = Report::new();
                if !goes_on {
                    break;
                }
            }
        }
        self.save(&folder)?;
        if !report.is_empty() {
            let progress = report.progress(&config, &self.state.position);
            on_report(&progress, &self.state);
        }
        Ok(())
    }

    fn save(&mut self, folder: &RunFolder) -> Result<(), TrainError> {
        folder.write(CHECKPOINT, &self.state.to_bytes()?)?;
        self.has_checkpoint = true;
        Ok(())
    }

    /// One optimisation step.
    fn step(&mut self, batch: &Batch, rate: f64) -> Result<(Losses, f32), TrainError> {
        let config = &self.config;
        let tracked = self.state.parameters.tracked();
        let input = input_of(batch, tracked.spec(), self.config.norms, &self.device);
        let tasks = Tasks::of(
            config,
            self.state.position.step,
            self.state.position.centres_started,
        );
        let mut network = Network::new(&tracked, Statistics::Batch);
        let (total, losses) = self.objective.compute(&mut network, &input, batch, tasks)?;
        let running = network.into_running();
        let is_trained = total.is_some();
        let length = match total {
            Some(total) => self.update(&tracked, total, rate)?,
            None => 0.0,
        };
        let terms = losses.terms().into_iter();
        let computed = terms.filter_map(|(name, value)| Some((name, value?)));
        for (what, value) in computed.chain([("gradient", length)]) {
            if !value.is_finite() {
                return Err(TrainError::NotFinite {
                    step: self.state.position.step,
                    what: format!("the {what}"),
                    checkpoint: self.has_checkpoint.then(|| checkpoint_path(&self.config)),
                });
            }
        }
        // Where no loss has a weight the data are those of a task that is not trained: its statistics are not the network's.
        if is_trained {
            for (name, value) in running {
                self.state.parameters.set(&name, value)?;
            }
        }
        self.update_average()?;
        Ok((losses, length))
    }

    /// Changes the parameters by the gradient of a loss. Returns the gradient's length before clipping.
    fn update(
        &mut self,
        tracked: &Parameters,
        total: Tensor<1>,
        rate: f64,
    ) -> Result<f32, TrainError> {
        let config = &self.config;
        let mut gradients = total.backward();
        let encoder = (rate * config.encoder_rate) as f32;
        self.state.adam.step(
            &mut self.state.parameters,
            tracked,
            &mut gradients,
            &StepOptions {
                adam: config.adam,
                clip: config.clip,
            },
            |name| {
                if name.starts_with("encoder.") {
                    encoder
                } else {
                    rate as f32
                }
            },
        )
    }

    /// Updates the moving average of the parameters, with a smaller decay in the first steps.
    fn update_average(&mut self) -> Result<(), TrainError> {
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

    /// Initialises NetVLAD from the vectors of map views.
    fn init_netvlad(&mut self) -> Result<(), TrainError> {
        let mut all = Vec::new();
        let scaled = self.state.parameters.spec().vlad.input.is_scaled();
        for i in 0..CENTRE_BATCHES {
            let batch = batch_of(
                &self.sources,
                Some(Task::Retrieval),
                &self.config.pairs,
                self.config.pairs_per_step,
                self.config.seed ^ 0xc1u64,
                i,
            );
            let batch = usable(batch, self.state.position.step)?;
            let input = input_of(
                &batch,
                self.state.parameters.spec(),
                self.config.norms,
                &self.device.clone().without_autodiff(),
            );
            let output =
                Network::new(&self.state.parameters, Statistics::Batch).forward(&input, false)?;
            let [_, h, w, d] = output.aggregated.dims();
            let vectors = output.aggregated.narrow(0, 0, batch.len());
            let vectors = vectors.reshape([batch.len() * h * w, d]);
            all.push(if scaled { unit_rows(vectors) } else { vectors });
        }
        init_netvlad(
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
        tracing::info!("NetVLAD initialised by k-means");
        Ok(())
    }
}

/// The state with normalisations that do not change the encoder's activations.
fn with_identity_norms(
    mut state: Checkpoint,
    config: &TrainConfig,
    sources: &Sources,
    device: &Device,
) -> Result<Checkpoint, TrainError> {
    let seed = config.seed ^ IDENTITY_SEED;
    let batch = batch_of(sources, None, &config.pairs, IDENTITY_PAIRS, seed, 0);
    let batch = usable(batch, 0)?;
    let plain = device.clone().without_autodiff();
    let spec = state.parameters.spec().clone();
    // Both domains get the statistics of their own views, whichever `norms` trains.
    let input = input_of(&batch, &spec, Norms::ByDomain, &plain);
    set_identity_norms(&mut state.parameters, &input)?;
    state.average = state.parameters.clone();
    Ok(state)
}
