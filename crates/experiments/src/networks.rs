//! The networks of an experiment that trains: variants of one configuration, each trained once, kept, and resumed after an
//! interruption.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use grimnet_net::Model;
use grimnet_output::OutputPolicy;
use grimnet_train::{
    Data, Device, Losses, MODEL, Progress, RunFolder, StepTable, TrainConfig, TrainError, Trainer,
    Weights, WhiteningChoice, checkpoint_path, export,
};

/// Digits of the hash that distinguishes variants with different training budgets.
const KEY_DIGITS: usize = 8;

/// File of how much the loss still fell at the end.
const LAST_FALL: &str = "last-fall.json";

/// Table of the total loss of each step, and its columns.
const TOTALS: &str = "total-losses.csv";
const TOTALS_COLUMNS: &str = "step,total";

/// Why a network cannot be trained or opened.
#[derive(Debug, thiserror::Error)]
pub enum NetworksError {
    /// Training.
    #[error(transparent)]
    Train(Box<TrainError>),
    /// A trained model cannot be read again.
    #[error(transparent)]
    Net(#[from] grimnet_net::NetError),
    /// A file cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// It was asked to stop.
    #[error(
        "stopped at step {step} of the network `{name}`; the checkpoint is in {folder}; run the same command to resume"
    )]
    Stopped {
        /// The network in hand.
        name: String,
        /// Steps it has made.
        step: u64,
        /// Where the networks are.
        folder: PathBuf,
    },
}

impl From<TrainError> for NetworksError {
    fn from(error: TrainError) -> Self {
        Self::Train(Box::new(error))
    }
}

/// A trained network.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The network.
    pub model: Model,
    /// By how much the total loss, the weighted sum that is trained on, fell from the last but one to the last tenth of the training, as a share of it; `None` if
    /// it was not watched, or too short.
    pub last_fall: Option<f64>,
}

impl Trained {
    /// Whether the training had reached its plateau.
    #[must_use]
    pub fn is_at_plateau(&self) -> Option<bool> {
        self.last_fall.map(|fall| fall < PLATEAU_FALL)
    }
}

/// A training whose losses fall by less than this share over its last tenth has reached its plateau.
const PLATEAU_FALL: f64 = 0.01;

/// Steps in a tenth of the training at least, for the mean over it to mean something.
const MIN_TENTH_STEPS: usize = 20;

/// See [`Trained::last_fall`].
fn last_fall_of(totals: &[f64]) -> Option<f64> {
    let tenth = totals.len() / 10;
    if tenth < MIN_TENTH_STEPS {
        return None;
    }
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let last = &totals[totals.len() - tenth..];
    let before = mean(&totals[totals.len() - 2 * tenth..totals.len() - tenth]);
    Some((before - mean(last)) / before)
}

/// The total loss (paper, eq. 25); the experiments have no other terms.
fn total_of(losses: &Losses, weights: &Weights) -> f64 {
    let terms = [
        (weights.global, losses.global),
        (weights.keypoint, losses.keypoint),
        (weights.descriptor, losses.descriptor),
        (weights.homography, losses.homography),
    ];
    let weighted = terms.map(|(weight, loss)| weight * loss.unwrap_or(0.0));
    f64::from(weighted.iter().sum::<f32>())
}

/// Called after every step with the network's name.
type Listener = Box<dyn Fn(&str, &Progress)>;

/// Trains variants of one configuration, all on the same data for the same seed.
pub struct Networks {
    config: TrainConfig,
    /// The data of each seed: procedural worlds differ with it, and are rendered once for all variants.
    data: Vec<Data>,
    folder: PathBuf,
    stop: Arc<AtomicBool>,
    on_progress: Listener,
}

impl Networks {
    /// Keeps networks in `folder`, `seeds` of each variant, each as `grim train` makes it of that configuration and seed. Setting
    /// `stop` ends training after the step in hand.
    ///
    /// # Errors
    /// A wrong configuration, data that cannot be read.
    pub fn new(
        config: TrainConfig,
        seeds: u64,
        folder: &Path,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, NetworksError> {
        config.validate()?;
        let of_seed = |i| {
            Data::open(&TrainConfig {
                seed: config.seed + i,
                ..config.clone()
            })
        };
        Ok(Self {
            data: (0..seeds.max(1)).map(of_seed).collect::<Result<_, _>>()?,
            // Every step is reported, so that a stop is heard at once.
            config: TrainConfig {
                report_steps: 1,
                validate_minutes: 0.0,
                ..config
            },
            folder: folder.to_owned(),
            stop,
            on_progress: Box::new(|_, _| ()),
        })
    }

    /// Calls `on_progress` after every step with the network's name.
    pub fn on_progress(&mut self, on_progress: impl Fn(&str, &Progress) + 'static) {
        self.on_progress = Box::new(on_progress);
    }

    /// The networks of the configuration changed by `change`, one for each seed: trained, resumed, or opened if they are finished.
    ///
    /// # Errors
    /// Training fails or was stopped; a file cannot be written or read.
    pub fn get(
        &self,
        name: &str,
        change: impl Fn(&mut TrainConfig),
    ) -> Result<Vec<Trained>, NetworksError> {
        self.data
            .iter()
            .zip(0..)
            .map(|(data, i)| {
                let mut config = self.config.clone();
                config.seed += i;
                change(&mut config);
                self.one(&format!("{name}, seed {}", config.seed), config, data)
            })
            .collect()
    }

    fn one(
        &self,
        name: &str,
        mut config: TrainConfig,
        data: &Data,
    ) -> Result<Trained, NetworksError> {
        config.out = self.folder.join(self.key(name, &config)?);
        let path = config.out.join(MODEL);
        let last_fall = config.out.join(LAST_FALL);
        if path.is_file() {
            let last_fall = fs_err::read(&last_fall).ok();
            return Ok(Trained {
                model: Model::open(&path)?,
                last_fall: last_fall.and_then(|text| serde_json::from_slice(&text).ok()),
            });
        }
        let device = config.device.device()?;
        let folder = RunFolder::open(&config, &OutputPolicy::new())?;
        let (trainer, totals) = self.trained(name, &config, data, &device, &folder)?;
        let exported = export(trainer.state(), &config, data, &device, &mut |_| ())?;
        let fall = last_fall_of(&totals);
        let text = format!("{}\n", serde_json::json!(fall));
        folder.write(LAST_FALL, text.as_bytes())?;
        folder.write_model(&exported.model)?;
        Ok(Trained {
            model: exported.model,
            last_fall: fall,
        })
    }

    fn trained(
        &self,
        name: &str,
        config: &TrainConfig,
        data: &Data,
        device: &Device,
        folder: &RunFolder,
    ) -> Result<(Trainer, Vec<f64>), NetworksError> {
        let resume = checkpoint_path(config).is_file();
        let mut trainer = Trainer::new(config.clone(), data.training.clone(), device, resume)?
            .with_folder(folder.clone());
        if resume {
            tracing::info!(
                "{name}: resumes after step {}",
                trainer.state().position.step
            );
        }
        let step = trainer.state().position.step;
        let mut totals = StepTable::open(folder, TOTALS, TOTALS_COLUMNS, step)?;
        let mut written = Ok(());
        let stopped = || self.stop.load(Ordering::Relaxed);
        if !stopped() {
            trainer.run(&mut |progress, _| {
                let total = total_of(&progress.losses, &config.weights);
                written = totals.add([format!("{},{total}", progress.step)]);
                (self.on_progress)(name, progress);
                written.is_ok() && !stopped()
            })?;
        }
        written?;
        if stopped() {
            return Err(NetworksError::Stopped {
                name: name.to_owned(),
                step: trainer.state().position.step,
                folder: self.folder.clone(),
            });
        }
        let total = |row: &String| row.split_once(',')?.1.parse().ok();
        Ok((trainer, totals.rows().iter().filter_map(total).collect()))
    }

    /// Folder of a variant: its name and a hash of its configuration, so that another budget is another network.
    fn key(&self, name: &str, config: &TrainConfig) -> Result<String, NetworksError> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{config:?}").as_bytes());
        if let Some(start) = &config.start_from {
            hasher.update(&fs_err::read(start)?);
        }
        let hash = hasher.finalize().to_hex();
        Ok(format!(
            "{}-{}",
            name.replace(", ", "-").replace(' ', "_"),
            &hash[..KEY_DIGITS]
        ))
    }

    /// The configuration that all variants change.
    pub(crate) fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Description of what the networks have in common.
    #[must_use]
    pub fn describe(&self) -> String {
        let length = self.config.steps.map_or_else(
            || format!("{} minutes", self.config.minutes),
            |steps| format!("{steps} steps of {} pairs", self.config.pairs_per_step),
        );
        let start = self.config.start_from.as_ref().map_or_else(
            || "random numbers".to_owned(),
            |path| {
                path.file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned()
            },
        );
        let export = &self.config.export;
        let whitening = match (export.whitening_pairs, export.whitening) {
            (0, _) => "are not whitened".to_owned(),
            (pairs, WhiteningChoice::Pca) => {
                format!("are whitened by principal components of {pairs} pairs")
            }
            (pairs, WhiteningChoice::Measured) => {
                format!("are whitened, or not, as is better on held-out pairs, by {pairs} pairs")
            }
        };
        format!(
            "Each network ({}) was trained for {length} with each of {} seeds, of batches, worlds and random weights, starting from {start}; global \
             descriptors {whitening}.",
            self.config.network,
            self.data.len()
        )
    }
}
