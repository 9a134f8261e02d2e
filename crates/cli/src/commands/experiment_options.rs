//! Options of `grim eval` that run the paper's experiments and robustness sweeps.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};

/// Whether this build leaves the experiments out; their options are then accepted, not shown, and answered with how to get them.
const ABSENT: bool = cfg!(not(feature = "experiments"));

/// The scenes of the procedural world: name, share of town. As many kinds of ground as the paper has scenes.
pub const WORLDS: [(&str, f32); 5] = [
    ("town", 0.95),
    ("suburb", 0.7),
    ("edge of town", 0.5),
    ("village", 0.3),
    ("fields", 0.1),
];

/// An experiment by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExperimentChoice {
    /// Processing resolution (table 2)
    Resolution,
    /// Combinations of modules (table 4)
    Modules,
    /// Number of candidates: recall, error and time (tables 5 and 6)
    TopK,
    /// Changes of light (table 7)
    Photometry,
    /// Methods compared (table 8)
    Methods,
    /// Success rate (table 9)
    Success,
    /// Normalisation by domain (table 10)
    DaBn,
    /// Weights of the losses (table 3); trains nine networks for each seed
    LossWeights,
    /// Retrieval and matching trained apart (table 4); trains three networks for each seed
    ModulesTrained,
    /// A network trained with plain normalisation (table 10); trains two networks for each seed
    DaBnTrained,
    /// All that need no training
    All,
}

impl ExperimentChoice {
    /// Whether it trains networks.
    pub fn trains(self) -> bool {
        matches!(
            self,
            Self::LossWeights | Self::ModulesTrained | Self::DaBnTrained
        )
    }

    /// Its name on the command line.
    pub fn name(self) -> String {
        self.to_possible_value()
            .map_or_else(|| format!("{self:?}"), |value| value.get_name().to_owned())
    }
}

/// A sweep by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SweepChoice {
    /// Heading of the photos, told and not told
    Yaw,
    /// Height, 0.5 to 2 times, told and not told
    Scale,
    /// Camera up to 45 degrees ahead of straight down
    Pitch,
    /// Brightness
    Brightness,
    /// Contrast
    Contrast,
    /// Blur
    Blur,
    /// Noise
    Noise,
    /// Season of the photos
    Season,
    /// Change since the map was made
    MapAge,
    /// Photos of another place, which must get no fix
    WrongArea,
    /// Heading of the photos, by the paper's procedure
    PaperYaw,
    /// All of these
    All,
}

/// Which experiments to run, and on how large a procedural world.
#[derive(Debug, Clone, Args)]
pub struct ExperimentOptions {
    /// Run these experiments of the paper, on FOLDER (a data set, or a folder of data sets) or on procedural worlds
    #[arg(
        long = "experiment",
        value_enum,
        value_name = "NAME",
        value_delimiter = ',',
        hide = ABSENT
    )]
    pub experiments: Vec<ExperimentChoice>,

    /// What the networks of an experiment that trains have in common, as for `grim train` [default: the paper's losses and weights,
    /// the compact network, pairs from procedural worlds]
    #[arg(long, hide = ABSENT, value_name = "FILE")]
    pub train_config: Option<PathBuf>,

    /// Length of each training, steps [default: what the configuration says; without one 20 minutes]
    #[arg(long, hide = ABSENT, value_name = "N")]
    pub train_steps: Option<u64>,

    /// Trainings of each network, with different seeds
    #[arg(long, hide = ABSENT, value_name = "N", default_value_t = 3)]
    pub train_seeds: u64,

    /// Maps of the scenes of a data set without maps, such as MSDI's, one for each scene [default: --map for all]
    #[arg(long = "scene-map", hide = ABSENT, value_name = "SCENE=MAP", value_parser = scene_map)]
    pub scene_maps: Vec<(String, PathBuf)>,

    /// Model that each training starts from [default: random numbers]
    #[arg(long, hide = ABSENT, value_name = "FILE")]
    pub train_start: Option<PathBuf>,

    /// Run these robustness sweeps on procedural worlds
    #[arg(long = "sweep", value_enum, value_name = "NAME", value_delimiter = ',', hide = ABSENT)]
    pub sweeps: Vec<SweepChoice>,

    /// Procedural worlds, each of another kind of ground
    #[arg(long, hide = ABSENT, value_name = "N", default_value_t = WORLDS.len(), value_parser = worlds_count)]
    pub worlds: usize,

    /// Photos over each procedural world
    #[arg(long, hide = ABSENT, value_name = "N", default_value_t = 12)]
    pub world_photos: usize,

    /// Side of a procedural world, metres
    #[arg(long, hide = ABSENT, value_name = "M", default_value_t = 700.0)]
    pub world_size: f64,

    /// Other procedural worlds for another number
    #[arg(long, hide = ABSENT, value_name = "N", default_value_t = 100)]
    pub world_seed: u64,
}

fn scene_map(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((scene, map)) if !scene.is_empty() && !map.is_empty() => {
            Ok((scene.to_owned(), map.into()))
        }
        _ => Err(
            "expected the name of a scene's folder and its map, such as museum=museum.tif".into(),
        ),
    }
}

fn worlds_count(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if (1..=WORLDS.len()).contains(&count) => Ok(count),
        _ => Err(format!("a number from 1 to {}", WORLDS.len())),
    }
}

impl ExperimentOptions {
    /// Whether anything is asked for.
    pub fn is_asked(&self) -> bool {
        !(self.experiments.is_empty() && self.sweeps.is_empty())
    }

    /// Returns an error with the way to get them if experiments were asked for and this build has none.
    ///
    /// # Errors
    /// See above.
    pub fn check_present(&self) -> Result<()> {
        if ABSENT && self.is_asked() {
            bail!(super::absent::message(
                "--experiment and --sweep",
                "experiments"
            ));
        }
        if let Some(choice) = self.experiments.iter().find(|choice| choice.trains())
            && cfg!(not(feature = "train"))
        {
            let option = format!("--experiment {}", choice.name());
            bail!(super::absent::message(&option, "train"));
        }
        Ok(())
    }
}
