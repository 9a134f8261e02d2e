//! The training configuration, as written in a TOML file.

use crate::data::{Folder, LabelOptions, PairOptions, WorldOptions};
use crate::loss::{HingeOptions, HomographyOptions, MultiSimilarityOptions, TripletOptions};
use crate::{Accelerator, ExportOptions, Norms, TeacherOptions, TrainError};
use grimnet_net::NetSpec;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Everything that decides a training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// What is trained. Each stage has its own folder, and starts from the one before by `start_from`.
    pub stage: Stage,
    /// Network preset: `compact`, `vgg16` or `vgg16-lateral`.
    pub network: String,
    /// What computes.
    pub device: Accelerator,
    /// Where checkpoints, models and curves go.
    pub out: PathBuf,
    /// Folders of pictures.
    pub data: Vec<Folder>,
    /// Share of the groups of pairs that come from the procedural world.
    pub world_share: f64,
    /// Those worlds.
    pub world: WorldOptions,
    /// A model file, or a checkpoint of another run, whose numbers the network starts with; of a smaller network, from which
    /// the encoder grows (`compact` fits into `vgg16`); or torchvision's `vgg16` or `vgg16_bn` weights (`.pth` or
    /// safetensors), whose convolutions `vgg16` starts with.
    pub start_from: Option<PathBuf>,
    /// Length of the run; the schedule ends here. Time in which the process was stopped does not count.
    pub minutes: f64,
    /// Length of the run in steps; where given, the schedule follows it and not the time.
    pub steps: Option<u64>,
    /// Seed of everything random.
    pub seed: u64,
    /// Pairs in a step.
    pub pairs_per_step: usize,
    /// Threads that make pairs.
    pub data_threads: usize,
    /// Peak learning rate (Adam).
    pub learning_rate: f64,
    /// The encoder's learning rate is this share of it (paper: 0.1; from random numbers 1).
    pub encoder_rate: f64,
    /// Steps over which the learning rate rises.
    pub warmup_steps: u64,
    /// Share of the run after which the learning rate falls, along a cosine, to nothing.
    pub decay_from: f64,
    /// Gradients longer than this, all together, are shortened to it.
    pub clip: f32,
    /// Share of the run's start without the global loss; then NetVLAD starts from clusters.
    pub global_from: f64,
    /// Weights of the losses.
    pub weights: Weights,
    /// A trained network to learn from, beside the other losses.
    pub teacher: Option<TeacherOptions>,
    /// Keypoint labels by homographic adaptation; where absent, the labels of pictures are corners that survive both looks.
    /// Procedural worlds always have the latter.
    pub labels: Option<LabelOptions>,
    /// How pairs are made.
    pub pairs: PairOptions,
    /// What local descriptors are compared by.
    pub descriptor_loss: DescriptorLoss,
    /// What global descriptors are compared by.
    pub global_loss: GlobalLoss,
    /// Settings of the descriptor hinge.
    pub hinge: HingeOptions,
    /// Settings of the triplet loss.
    pub triplet: TripletOptions,
    /// Settings of the multi-similarity loss.
    pub multi_similarity: MultiSimilarityOptions,
    /// Settings of the homography loss.
    pub homography: HomographyOptions,
    /// Whether steps train retrieval and matching by turns (the paper), or both at once.
    pub alternate: bool,
    /// Whether each domain is normalised by itself.
    pub norms: Norms,
    /// Temperature of the descriptor contrast.
    pub descriptor_temperature: f32,
    /// Temperature of the global contrast.
    pub global_temperature: f32,
    /// Past batches whose map views are negatives, too.
    pub memory_batches: usize,
    /// Share of the old value in the running average of the parameters, per step.
    pub average_decay: f32,
    /// Minutes between checkpoints.
    pub checkpoint_minutes: f64,
    /// Minutes between validations; 0 for none.
    pub validate_minutes: f64,
    /// Steps between progress reports.
    pub report_steps: u64,
    /// What the exported model is fitted and measured with.
    pub export: ExportOptions,
}

/// The stages of training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Keypoints, local and global descriptors, on pairs of views.
    #[default]
    Joint,
    /// The keypoint head alone, or with the layers it stands on, on drawn figures whose corners are known (SuperPoint's first
    /// stage; DeTone et al. 2018). Needs no pictures.
    Shapes,
    /// The encoder alone, by scene classes, on pictures in one folder a class.
    Scenes,
}

impl std::fmt::Display for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Joint => "joint",
            Self::Shapes => "shapes",
            Self::Scenes => "scenes",
        })
    }
}

/// Weights of the losses in their sum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Keypoint cross-entropy.
    pub keypoint: f32,
    /// Weight of cells without a keypoint in it.
    pub dustbin: f32,
    /// Local descriptors.
    pub descriptor: f32,
    /// Global descriptors.
    pub global: f32,
    /// Homography reprojection; 0 leaves it out.
    pub homography: f32,
}

/// Losses for local descriptors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DescriptorLoss {
    /// Dual softmax over the points of a pair.
    #[default]
    Contrast,
    /// The paper's hinge over all pairs of points (eq. 16-17).
    Hinge,
}

/// Losses for global descriptors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GlobalLoss {
    /// InfoNCE within the batch and against the memory.
    #[default]
    Contrast,
    /// The paper's triplet with the hardest negatives of the batch (eq. 9).
    Triplet,
    /// Multi-similarity within the batch.
    MultiSimilarity,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            keypoint: 1.0,
            dustbin: 0.3,
            descriptor: 1.0,
            global: 0.5,
            homography: 0.0,
        }
    }
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
        }
    }
}

impl TrainConfig {
    /// The paper's recipe (sections 3.4-3.6 and 4.1): its network, losses, weights and turns, and a tenth of the rate for
    /// the encoder. Data and length are for the user to set.
    pub fn paper() -> Self {
        Self {
            network: "vgg16".into(),
            encoder_rate: 0.1,
            weights: Weights {
                keypoint: 0.5,
                dustbin: 1.0,
                descriptor: 0.5,
                global: 1.0,
                homography: 0.3,
            },
            descriptor_loss: DescriptorLoss::Hinge,
            global_loss: GlobalLoss::Triplet,
            alternate: true,
            export: ExportOptions {
                whitening_pairs: 1100,
                ..ExportOptions::default()
            },
            ..Self::default()
        }
    }

    /// Reads a TOML file.
    ///
    /// # Errors
    /// [`TrainError::Io`], or [`TrainError::Config`] with the line that is wrong.
    pub fn open(path: &Path) -> Result<Self, TrainError> {
        let text = fs_err::read_to_string(path)?;
        let config: Self = toml::from_str(&text).map_err(|error| TrainError::Config {
            reason: format!("{}: {error}", path.display()),
        })?;
        config.validate()?;
        Ok(config)
    }

    /// The network.
    ///
    /// # Errors
    /// [`TrainError::Config`] where there is no such preset.
    pub fn spec(&self) -> Result<NetSpec, TrainError> {
        NetSpec::preset(&self.network).ok_or_else(|| TrainError::Config {
            reason: format!(
                "`network = \"{}\"` is no preset; write compact, vgg16 or vgg16-lateral",
                self.network
            ),
        })
    }

    /// The short side that a picture needs for a view to be cut from it, pixels.
    pub fn least_picture_px(&self) -> u32 {
        self.pairs.side_px * 3 / 4
    }

    /// Checks what a run would stumble over.
    ///
    /// # Errors
    /// [`TrainError::Config`] with what to write instead.
    pub fn validate(&self) -> Result<(), TrainError> {
        let wrong = |reason: &str| {
            Err(TrainError::Config {
                reason: reason.to_owned(),
            })
        };
        let values = self.spec()?.global_len();
        if (1..=values).contains(&self.export.whitening_pairs) {
            return wrong(&format!(
                "`export.whitening_pairs` must be above {values}, the length of the descriptor, or 0 for no whitening"
            ));
        }
        let cells = (self.pairs.side_px / 8).pow(2) as usize;
        if self.pairs.side_px == 0 || !self.pairs.side_px.is_multiple_of(32) {
            return wrong("`pairs.side_px` must be a multiple of 32");
        }
        if self.pairs.points == 0 || self.pairs.points > cells / 2 {
            return wrong("`pairs.points` must be between 1 and half the number of 8 x 8 cells");
        }
        if self.pairs_per_step < 2 || self.pairs.group == 0 {
            return wrong("`pairs_per_step` must be at least 2 and `pairs.group` at least 1");
        }
        if !(self.minutes > 0.0 && self.learning_rate > 0.0 && self.clip > 0.0) {
            return wrong("`minutes`, `learning_rate` and `clip` must be positive");
        }
        if let Some(labels) = &self.labels
            && (labels.views == 0 || labels.side_px == 0 || !labels.side_px.is_multiple_of(32))
        {
            return wrong(
                "`labels.views` must be at least 1 and `labels.side_px` a multiple of 32",
            );
        }
        if !(0.0..=1.0).contains(&self.world_share) {
            return wrong("`world_share` must be between 0 and 1");
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
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_preset_file_is_the_paper() {
        let preset: TrainConfig = toml::from_str(include_str!("../presets/paper.toml")).unwrap();
        assert_eq!(preset, TrainConfig::paper());
    }

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
}
