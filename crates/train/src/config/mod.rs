//! The training configuration, as written in a TOML file.

mod changes;
mod export_options;
mod losses;
mod paper;
mod ranges;
mod stage;

pub(crate) use changes::Changes;
pub use export_options::{ExportOptions, WhiteningChoice};
pub use losses::{DescriptorLoss, GlobalLoss, Weights};
pub use stage::Stage;

use crate::data::{Folder, LabelOptions, PairOptions, Serves, Task, WorldOptions};
use crate::error::TrainError;
use crate::loss::{HingeOptions, HomographyOptions, MultiSimilarityOptions, TripletOptions};
use crate::model::device::Accelerator;
use crate::model::input::Norms;
use crate::model::teacher::TeacherOptions;
use crate::run::optimiser::AdamOptions;
use grimnet_limits::PhotoLimits;
use grimnet_net::NetSpec;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A training run. Read from a TOML file, in which every key has the name of a field here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// What is trained. Each stage has its own output folder and starts from the previous one with `start_from`.
    pub stage: Stage,
    /// Network preset: `compact`, `vgg16`, `vgg16-lateral` or `vgg16-paper` ([`NetSpec::presets`]).
    pub network: String,
    /// The device that computes.
    pub device: Accelerator,
    /// Output folder: checkpoint, model, curves.
    pub out: PathBuf,
    /// Folders of training data.
    pub data: Vec<Folder>,
    /// Share of the groups of pairs that come from procedural worlds, 0 to 1.
    pub world_share: f64,
    /// The procedural worlds.
    pub world: WorldOptions,
    /// Initial weights: a model file; a checkpoint of another run; either of a smaller network, from which the encoder is
    /// widened and deepened (`compact` fits into `vgg16`); or torchvision's `vgg16` or `vgg16_bn` weights (`.pth` or
    /// safetensors), for the encoder of `vgg16` and its variants. Random weights if absent.
    pub start_from: Option<PathBuf>,
    /// Length of the run in minutes; the schedule ends here. Time in which the process was suspended does not count.
    pub minutes: f64,
    /// Length of the run in steps; replaces `minutes` if given.
    pub steps: Option<u64>,
    /// Seed of everything random.
    pub seed: u64,
    /// Pairs in each step.
    pub pairs_per_step: usize,
    /// Threads that make pairs.
    pub data_threads: usize,
    /// Peak learning rate.
    pub learning_rate: f64,
    /// Learning rate of the encoder as a share of `learning_rate`.
    pub encoder_rate: f64,
    /// Settings of Adam.
    pub adam: AdamOptions,
    /// Steps of linear warm-up of the learning rate.
    pub warmup_steps: u64,
    /// Share of the run after which the learning rate decays to a thousandth along a cosine; 1 disables the decay.
    pub decay_from: f64,
    /// Maximum norm of the gradient of all parameters; longer gradients are scaled down to it. `inf` disables clipping.
    pub clip: f32,
    /// Share of the run that is trained without the global loss. NetVLAD is initialised by k-means when this share is over. It has no
    /// effect where `start_from` gives an initialised NetVLAD, which is trained from the first step.
    pub global_from: f64,
    /// Weights of the losses.
    pub weights: Weights,
    /// A trained network whose outputs are additional targets (distillation).
    pub teacher: Option<TeacherOptions>,
    /// Keypoint labels by homographic adaptation. If absent, the labels of pictures are corners found under the looks of both
    /// views. Procedural worlds always use such corners.
    pub labels: Option<LabelOptions>,
    /// How pairs are made.
    pub pairs: PairOptions,
    /// Loss of local descriptors.
    pub descriptor_loss: DescriptorLoss,
    /// Loss of global descriptors.
    pub global_loss: GlobalLoss,
    /// Settings of the descriptor hinge.
    pub hinge: HingeOptions,
    /// Settings of the triplet loss.
    pub triplet: TripletOptions,
    /// Settings of the multi-similarity loss.
    pub multi_similarity: MultiSimilarityOptions,
    /// Settings of the homography loss.
    pub homography: HomographyOptions,
    /// Train matching in the first step, retrieval in the second, and so on in turns (paper, section 4.3), each on the data that serves
    /// it, instead of both in every step.
    pub alternate: bool,
    /// Whether each domain has its own normalisation.
    pub norms: Norms,
    /// Temperature of the contrastive loss of local descriptors.
    pub descriptor_temperature: f32,
    /// Temperature of the contrastive loss of global descriptors.
    pub global_temperature: f32,
    /// Number of past batches whose map views are additional negatives of the contrastive global loss.
    pub memory_batches: usize,
    /// Decay of the exponential moving average of the parameters, per step; 0 exports the parameters themselves, with
    /// the running statistics of their normalisations. Those of averaged parameters are recomputed from training pairs.
    pub average_decay: f32,
    /// Minutes between checkpoints.
    pub checkpoint_minutes: f64,
    /// Minutes between validations; 0 disables them.
    pub validate_minutes: f64,
    /// Steps between progress reports.
    pub report_steps: u64,
    /// Fitting and measuring the exported model.
    pub export: ExportOptions,
    /// Limits on each picture; not a part of the file.
    #[serde(skip)]
    pub photo_limits: PhotoLimits,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            stage: Stage::default(),
            network: "compact".into(),
            device: Accelerator::default(),
            out: "training".into(),
            data: Vec::new(),
            world_share: 0.0,
            world: WorldOptions::default(),
            start_from: None,
            minutes: 60.0,
            steps: None,
            seed: 1,
            pairs_per_step: 12,
            data_threads: 1,
            learning_rate: 1e-3,
            encoder_rate: 1.0,
            adam: AdamOptions::default(),
            warmup_steps: 50,
            decay_from: 0.5,
            clip: 5.0,
            global_from: 0.1,
            weights: Weights::default(),
            teacher: None,
            labels: None,
            pairs: PairOptions::default(),
            descriptor_loss: DescriptorLoss::default(),
            global_loss: GlobalLoss::default(),
            hinge: HingeOptions::default(),
            triplet: TripletOptions::default(),
            multi_similarity: MultiSimilarityOptions::default(),
            homography: HomographyOptions::default(),
            alternate: false,
            norms: Norms::default(),
            descriptor_temperature: 0.05,
            global_temperature: 1.0 / 16.0,
            memory_batches: 40,
            average_decay: 0.998,
            checkpoint_minutes: 4.0,
            validate_minutes: 15.0,
            report_steps: 50,
            export: ExportOptions::default(),
            photo_limits: PhotoLimits::DEFAULT,
        }
    }
}

impl TrainConfig {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// [`TrainError::Io`]; [`TrainError::Config`] with the line of the error.
    pub fn open(path: &Path) -> Result<Self, TrainError> {
        let text = fs_err::read_to_string(path)?;
        let config: Self = toml::from_str(&text).map_err(|error| TrainError::Config {
            reason: format!("{}: {error}", path.display()),
        })?;
        config.validate()?;
        Ok(config)
    }

    /// The description of the network.
    ///
    /// # Errors
    /// [`TrainError::Config`] if there is no such preset.
    pub fn spec(&self) -> Result<NetSpec, TrainError> {
        NetSpec::preset(&self.network).ok_or_else(|| TrainError::Config {
            reason: format!(
                "`network = \"{}\"`: unknown preset; use compact, vgg16, vgg16-lateral or vgg16-paper",
                self.network
            ),
        })
    }

    /// Shortest side of a picture from which views can be cut, pixels.
    pub fn least_picture_px(&self) -> u32 {
        self.pairs.side_px * 3 / 4
    }

    /// Whether a loss of the global descriptor has a weight, the teacher's among them.
    pub(crate) fn trains_global_descriptor(&self) -> bool {
        let teacher = self.teacher.as_ref();
        self.weights.global > 0.0 || teacher.is_some_and(|teacher| teacher.global > 0.0)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`TrainError::Config`] with the value that is wrong and what is accepted.
    pub fn validate(&self) -> Result<(), TrainError> {
        let wrong = |reason: &str| {
            Err(TrainError::Config {
                reason: reason.to_owned(),
            })
        };
        self.validate_numbers()?;
        if self.out.as_os_str().is_empty() {
            return wrong("`out` is empty; name the folder of the run");
        }
        let values = self.spec()?.global_len();
        if (1..=values).contains(&self.export.whitening_pairs) {
            return wrong(&format!(
                "`export.whitening_pairs` must be above {values}, the length of the descriptor, or 0 for no whitening"
            ));
        }
        let has_pca = self.export.whitening == WhiteningChoice::Pca;
        if has_pca && self.spec()?.has_whitening() && self.export.whitening_pairs == 0 {
            return wrong(&format!(
                "`export.whitening = \"pca\"` needs `export.whitening_pairs` above {values}"
            ));
        }
        if !self.pairs.side_px.is_multiple_of(32) {
            return wrong("`pairs.side_px` must be a multiple of 32");
        }
        let side_px = self.pairs.side_px;
        let most_points = (side_px as usize / 8).pow(2) / 2;
        if self.pairs.points > most_points {
            return wrong(&format!(
                "`pairs.points` is {}; with `pairs.side_px = {side_px}` it must be at most {most_points}, half the number of 8 x 8 cells",
                self.pairs.points
            ));
        }
        if let Some(labels) = &self.labels
            && !labels.side_px.is_multiple_of(32)
        {
            return wrong("`labels.side_px` must be a multiple of 32");
        }
        if self.labels.as_ref().is_some_and(|l| l.look.mixed > 0.0) {
            return wrong(
                "`labels.look.mixed` must be 0: labels of a picture use no other picture",
            );
        }
        if self.world_share > 0.0 && (self.world.worlds == 0 || self.world.places == 0) {
            return wrong("`world.worlds` and `world.places` must be at least 1");
        }
        if self.stage == Stage::Scenes && self.world_share > 0.0 {
            return wrong("procedural worlds have no scene classes: `world_share` must be 0");
        }
        if self.stage != Stage::Shapes && self.data.is_empty() && self.world_share < 1.0 {
            return wrong("no `[[data]]` folder is given, and `world_share` is below 1");
        }
        self.to_table()?;
        let weights = &self.weights;
        let of_losses = [
            weights.keypoint,
            weights.descriptor,
            weights.global,
            weights.homography,
        ];
        let is_untaught = self.teacher.as_ref().is_none_or(|teacher| {
            [teacher.keypoint, teacher.descriptor, teacher.global] == [0.0; 3]
        });
        if self.stage == Stage::Joint && is_untaught && of_losses == [0.0; 4] {
            return wrong("all `weights` are 0; set at least one");
        }
        self.validate_tasks()
    }

    /// Checks that each of the two tasks has data, if data serve one task only.
    fn validate_tasks(&self) -> Result<(), TrainError> {
        let wrong = |reason: &str| {
            Err(TrainError::Config {
                reason: reason.to_owned(),
            })
        };
        if self.stage != Stage::Joint || self.data.iter().all(|f| f.serves == Serves::Both) {
            return Ok(());
        }
        if !self.alternate || self.global_from > 0.0 {
            return wrong(
                "`serves` other than \"both\" needs `alternate = true` and `global_from = 0`",
            );
        }
        for task in [Task::Retrieval, Task::Matching] {
            let served = self.data.iter().any(|f| f.serves.includes(Some(task)));
            if !served && self.world_share == 0.0 {
                return wrong(&format!(
                    "no `[[data]]` folder serves the task {task:?}; add one, or set `serves = \"both\"`"
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Layout;
    use std::path::Path;

    #[test]
    fn a_configuration_survives_being_written() {
        let config = TrainConfig {
            steps: Some(7),
            start_from: Some("first.safetensors".into()),
            ..TrainConfig::paper()
        };
        let text = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<TrainConfig>(&text).unwrap(), config);
    }

    #[test]
    fn data_for_one_task_need_turns_and_data_for_the_other() {
        let folder = |serves| Folder {
            path: Path::new("somewhere").to_owned(),
            layout: Layout::default(),
            repeat: 1,
            serves,
        };
        let with = |serves: &[Serves], alternate, global_from| {
            let config = TrainConfig {
                data: serves.iter().copied().map(folder).collect(),
                alternate,
                global_from,
                ..TrainConfig::default()
            };
            config.validate().is_ok()
        };
        assert!(with(&[Serves::Both], false, 0.1));
        assert!(with(&[Serves::Retrieval, Serves::Matching], true, 0.0));
        assert!(with(&[Serves::Retrieval, Serves::Both], true, 0.0));
        assert!(!with(&[Serves::Retrieval, Serves::Matching], false, 0.0));
        assert!(!with(&[Serves::Retrieval, Serves::Matching], true, 0.1));
        assert!(!with(&[Serves::Retrieval], true, 0.0));
        assert!(!with(&[Serves::Matching], true, 0.0));
    }
}
