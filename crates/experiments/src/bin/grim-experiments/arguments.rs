//! Arguments of `grim-experiments`.

use std::path::PathBuf;

use clap::{Args, Parser};
use grimnet_eval::scene::HeadingMode;
use grimnet_experiments::sweep::Sweep;
use grimnet_program::general::GeneralOptions;
use grimnet_program::heading_modes::{BOTH, heading_modes};
use grimnet_program::limits_choice::LimitsChoice;
use grimnet_program::map_place::MapPlace;
use grimnet_program::model_choice::ModelChoice;
use grimnet_program::outputs::OverwriteChoice;
use grimnet_program::values;

use crate::named::{Named, Requested, experiments, sweeps};

/// The procedural worlds: name, share of town. As many kinds of ground as the paper has scenes.
pub const WORLDS: [(&str, f32); 5] = [
    ("town", 0.95),
    ("suburb", 0.7),
    ("edge of town", 0.5),
    ("village", 0.3),
    ("fields", 0.1),
];

/// Headings of groups of options in the help.
const DISTRACTORS: &str = "Retrieval among distractors";
const WORLD: &str = "Procedural worlds";
const TRAINING: &str = "Experiments that train networks";

const EXAMPLES: &str = "\
Examples:
  grim-experiments --experiment all --out tables                        # on procedural worlds
  grim-experiments MSDI --scene-map museum=museum.tif --experiment success --out tables
  grim-experiments --sweep yaw,scale --worlds 2 --out sweeps
  grim-experiments flight --distractors aerial/ --gsd 0.3 --out gallery
  grim-experiments --experiment loss-weights --train-steps 2000 --out tables";

/// The experiments of the GRiM-Net publication, and robustness sweeps.
///
/// Each writes its table as JSON, CSV and Markdown into the folder of results and prints it.
#[derive(Debug, Parser)]
#[command(name = "grim-experiments", version, after_help = EXAMPLES)]
pub struct Arguments {
    /// A data set as for `grim eval`, or a folder of data sets [default: procedural worlds]
    pub folder: Option<PathBuf>,

    /// Folder for the tables; packs and trained networks are kept in its folder `work`
    #[arg(short, long, value_name = "DIR", value_parser = values::output_folder())]
    pub out: PathBuf,

    #[command(flatten)]
    pub overwrite: OverwriteChoice,

    /// Run these experiments of the paper
    #[arg(
        long = "experiment",
        value_parser = experiments(),
        value_name = "NAME",
        value_delimiter = ','
    )]
    pub experiments: Vec<Named<Requested>>,

    /// Run these robustness sweeps, on procedural worlds
    #[arg(long = "sweep", value_parser = sweeps(), value_name = "NAME", value_delimiter = ',')]
    pub sweeps: Vec<Named<Sweep>>,

    /// The map of every data set [default: map.tif in its folder]
    #[arg(long, value_name = "MAP", requires = "folder")]
    pub map: Option<PathBuf>,

    /// The map of one data set in FOLDER, for data without maps such as MSDI [default: --map for all]
    #[arg(long = "scene-map", value_name = "SCENE=MAP", value_parser = scene_map, requires = "folder")]
    pub scene_maps: Vec<(String, PathBuf)>,

    #[command(flatten)]
    pub place: MapPlace,

    #[command(flatten)]
    pub model: ModelChoice,

    /// Ground width that every photo shows, metres, given to the localiser instead of truth file and metadata
    #[arg(
        long,
        value_name = "M",
        value_parser = values::length_m,
        allow_hyphen_values = true,
        requires = "folder"
    )]
    pub footprint_width: Option<f64>,

    #[command(flatten)]
    pub distractors: DistractorOptions,

    #[command(flatten)]
    pub worlds: WorldOptions,

    #[command(flatten)]
    pub training: TrainingOptions,

    #[command(flatten)]
    pub limits: LimitsChoice,

    #[command(flatten)]
    pub general: GeneralOptions,
}

/// Retrieval among the tiles of other maps.
#[derive(Debug, Args)]
pub struct DistractorOptions {
    /// Measure recall with the tiles of this other map, or of all pictures in this folder, beside those of the data set's map
    #[arg(
        long,
        value_name = "MAP|FOLDER",
        requires_all = ["gsd", "folder"],
        help_heading = DISTRACTORS
    )]
    pub distractors: Option<PathBuf>,

    /// Ground resolution that is searched, metres per pixel; distractors without a georeference are assumed to have it
    #[arg(
        long,
        value_name = "M",
        value_parser = values::gsd_m,
        allow_hyphen_values = true,
        requires = "distractors",
        help_heading = DISTRACTORS
    )]
    pub gsd: Option<f64>,

    /// Whether the localiser is given the true headings
    #[arg(
        long,
        value_parser = heading_modes(),
        default_value = BOTH,
        requires = "distractors",
        help_heading = DISTRACTORS
    )]
    pub heading: &'static [HeadingMode],
}

/// How many and how large procedural worlds.
#[derive(Debug, Clone, Args)]
pub struct WorldOptions {
    /// Number of worlds, each of another kind of ground
    #[arg(long, value_name = "N", default_value_t = WORLDS.len(), value_parser = worlds_count, help_heading = WORLD)]
    pub worlds: usize,

    /// Photos over each world
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = values::count, help_heading = WORLD)]
    pub world_photos: usize,

    /// Side of a world, metres
    #[arg(
        long,
        value_name = "M",
        default_value_t = 700.0,
        value_parser = values::length_m,
        allow_hyphen_values = true,
        help_heading = WORLD
    )]
    pub world_size: f64,

    /// Seed of the first world
    #[arg(long, value_name = "N", default_value_t = 100, help_heading = WORLD)]
    pub world_seed: u64,
}

/// What the networks of an experiment that trains have in common.
#[derive(Debug, Clone, Args)]
pub struct TrainingOptions {
    /// Configuration, as for `grim train` [default: the paper's losses and weights, the compact network, pairs from procedural
    /// worlds]
    #[arg(long, value_name = "FILE", help_heading = TRAINING)]
    pub train_config: Option<PathBuf>,

    /// Length of each training, steps [default: that of the configuration; without one 20 minutes]
    #[arg(long, value_name = "N", help_heading = TRAINING)]
    pub train_steps: Option<u64>,

    /// Trainings of each network, with different seeds
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = TRAINING)]
    pub train_seeds: u64,

    /// Model that each training starts from [default: random weights]
    #[arg(long, value_name = "FILE", help_heading = TRAINING)]
    pub train_start: Option<PathBuf>,
}

fn scene_map(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((scene, map)) if !scene.is_empty() && !map.is_empty() => {
            Ok((scene.to_owned(), map.into()))
        }
        _ => Err(
            "expected the name of a data set's folder and its map, such as museum=museum.tif"
                .into(),
        ),
    }
}

fn worlds_count(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if (1..=WORLDS.len()).contains(&count) => Ok(count),
        _ => Err(format!("expected a number from 1 to {}", WORLDS.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;
    use grimnet_experiments::experiment::Experiment;
    use grimnet_experiments::training::TrainedExperiment;

    use crate::named::flat;

    fn parsed(arguments: &[&str]) -> Result<Arguments, String> {
        let all = ["grim-experiments", "--out", "x"].iter().chain(arguments);
        Arguments::try_parse_from(all).map_err(|error| error.to_string())
    }

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn names_stand_for_experiments_and_sweeps() {
        let given = parsed(&[
            "--experiment",
            "top-k,da-bn-trained",
            "--sweep",
            "blur,map-age",
        ])
        .unwrap();
        assert_eq!(
            flat(&given.experiments),
            [
                Requested::Measured(Experiment::TopK),
                Requested::Trained(TrainedExperiment::DaBn)
            ]
        );
        assert_eq!(flat(&given.sweeps), [Sweep::Blur, Sweep::MapAge]);
        let all = parsed(&["--experiment", "all", "--sweep", "all"]).unwrap();
        assert_eq!(
            flat(&all.experiments),
            Experiment::ALL.map(Requested::Measured)
        );
        assert_eq!(flat(&all.sweeps), Sweep::ALL);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let refused = |arguments: &[&str], says: &str| {
            let error = parsed(arguments).unwrap_err();
            assert!(error.contains(says), "{error}");
        };
        refused(&["--experiment", "table2"], "resolution");
        refused(&["--worlds", "6"], "from 1 to 5");
        refused(&["--distractors", "aerial"], "--gsd");
        refused(&["--distractors", "aerial", "--gsd", "0.3"], "FOLDER");
        refused(&["data", "--scene-map", "museum"], "museum=museum.tif");
        refused(&["--footprint-width", "157"], "FOLDER");
    }
}
