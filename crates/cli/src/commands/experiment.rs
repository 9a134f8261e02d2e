//! `grim eval --experiment` and `--sweep`: the paper's tables, and robustness, on any data set or the procedural world.

mod training;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use grimnet_eval::experiment::bench::Bench;
use grimnet_eval::experiment::flight::WorldFlight;
use grimnet_eval::experiment::page;
use grimnet_eval::experiment::scene::Scene;
use grimnet_eval::experiment::sweep::{self, Sweep};
use grimnet_eval::experiment::tables::{self, Experiment, Recipe};
use grimnet_eval::experiment_table::ExperimentTable;
use grimnet_geo::open_map;
use grimnet_net::Model;

use super::ModeChoice;
use super::eval_layout::{Layout, LayoutChoice};
use super::map::MapPlace;
use crate::exit::Exit;
use crate::progress;
use training::Training;

/// The scenes of the procedural world: name, share of town. As many kinds of ground as the paper has scenes.
const WORLDS: [(&str, f32); 5] = [
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
    /// Weights of the losses (table 3); trains nine networks
    LossWeights,
    /// Retrieval and matching trained apart (table 4); trains three networks
    ModulesTrained,
    /// A network trained with plain normalisation (table 10); trains two networks
    DaBnTrained,
    /// All that need no training
    All,
}

impl ExperimentChoice {
    /// Whether it trains networks.
    fn trains(self) -> bool {
        matches!(
            self,
            Self::LossWeights | Self::ModulesTrained | Self::DaBnTrained
        )
    }

    /// Its name on the command line.
    fn name(self) -> String {
        self.to_possible_value()
            .map_or_else(|| format!("{self:?}"), |value| value.get_name().to_owned())
    }

    /// The tables that need no training.
    fn tables(self) -> Vec<Experiment> {
        match self {
            Self::LossWeights | Self::ModulesTrained | Self::DaBnTrained => vec![],
            Self::Resolution => vec![Experiment::Resolution],
            Self::Modules => vec![Experiment::Modules],
            Self::TopK => vec![Experiment::TopKRecall, Experiment::TopK],
            Self::Photometry => vec![Experiment::Photometry],
            Self::Methods => vec![Experiment::Methods],
            Self::Success => vec![Experiment::Success],
            Self::DaBn => vec![Experiment::DaBn],
            Self::All => vec![
                Experiment::Success,
                Experiment::Methods,
                Experiment::TopKRecall,
                Experiment::TopK,
                Experiment::Photometry,
                Experiment::DaBn,
                Experiment::Modules,
                Experiment::Resolution,
            ],
        }
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
    /// All of these
    All,
}

impl SweepChoice {
    fn sweeps(self) -> Vec<Sweep> {
        let one = match self {
            Self::Yaw => Sweep::Yaw,
            Self::Scale => Sweep::Scale,
            Self::Pitch => Sweep::Pitch,
            Self::Brightness => Sweep::Brightness,
            Self::Contrast => Sweep::Contrast,
            Self::Blur => Sweep::Blur,
            Self::Noise => Sweep::Noise,
            Self::Season => Sweep::Season,
            Self::MapAge => Sweep::MapAge,
            Self::WrongArea => Sweep::WrongArea,
            Self::All => return Sweep::ALL.to_vec(),
        };
        vec![one]
    }
}

/// Which experiments to run, and on how large a procedural world.
#[derive(Debug, Clone, Args)]
pub struct ExperimentOptions {
    /// Run these experiments of the paper, on FOLDER (a data set, or a folder of data sets) or on procedural worlds
    #[arg(
        long = "experiment",
        value_enum,
        value_name = "NAME",
        value_delimiter = ','
    )]
    pub experiments: Vec<ExperimentChoice>,

    /// What the networks of an experiment that trains have in common, as for `grim train` [default: the paper's losses and weights,
    /// the compact network, pairs from procedural worlds]
    #[arg(long, value_name = "FILE")]
    pub train_config: Option<PathBuf>,

    /// Length of each training, steps [default: what the configuration says; without one 300]
    #[arg(long, value_name = "N")]
    pub train_steps: Option<u64>,

    /// Model that each training starts from [default: random numbers]
    #[arg(long, value_name = "FILE")]
    pub train_start: Option<PathBuf>,

    /// Run these robustness sweeps on procedural worlds
    #[arg(long = "sweep", value_enum, value_name = "NAME", value_delimiter = ',')]
    pub sweeps: Vec<SweepChoice>,

    /// Procedural worlds, each of another kind of ground
    #[arg(long, value_name = "N", default_value_t = WORLDS.len(), value_parser = worlds_count)]
    pub worlds: usize,

    /// Photos over each procedural world
    #[arg(long, value_name = "N", default_value_t = 12)]
    pub world_photos: usize,

    /// Side of a procedural world, metres
    #[arg(long, value_name = "M", default_value_t = 700.0)]
    pub world_size: f64,

    /// Other procedural worlds for another number
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub world_seed: u64,
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

    fn flights(&self) -> Vec<WorldFlight> {
        WORLDS
            .iter()
            .enumerate()
            .take(self.worlds)
            .map(|(i, &(name, urban))| {
                WorldFlight::over(
                    name,
                    self.world_seed + i as u64,
                    self.world_size,
                    urban,
                    self.world_photos,
                )
            })
            .collect()
    }
}

/// What the experiments run on, and with.
pub struct Subject<'a> {
    /// A data set, a folder of data sets, or none for procedural worlds.
    pub folder: Option<&'a Path>,
    /// How the maps are placed where they do not tell it.
    pub place: &'a MapPlace,
    /// Width of ground that the photos show, metres, where it is known better than their metadata say.
    pub footprint_width_m: Option<f64>,
    /// The recipe.
    pub mode: ModeChoice,
    /// The network.
    pub model: &'a Model,
}

impl Subject<'_> {
    fn recipe(&self) -> Recipe {
        match self.mode {
            ModeChoice::Default => Recipe::Default,
            ModeChoice::Paper => Recipe::Paper,
        }
    }
}

/// Runs what was asked for and writes a table each, as JSON, CSV and Markdown, into `out`; sweeps also as `sweeps.html`.
///
/// # Errors
/// Unreadable data, a pack that cannot be built, results that cannot be written.
pub fn run(options: &ExperimentOptions, subject: &Subject<'_>, out: &Path) -> Result<Exit> {
    let work = out.join("work");
    let mut training = Training::open(options, &work)?;
    fs_err::create_dir_all(&work)?;
    let mut tables = experiments(options, subject, &mut training, out, &work)?;
    let swept = sweeps(options, subject, out, &work)?;
    if !swept.is_empty() {
        let title = "Accuracy as conditions get worse";
        fs_err::write(out.join("sweeps.html"), page::page(title, &swept)?)?;
    }
    tables.extend(swept);
    let mut stdout = std::io::stdout().lock();
    for table in &tables {
        writeln!(stdout, "{}", table.to_markdown())?;
    }
    Ok(Exit::Done)
}

fn experiments(
    options: &ExperimentOptions,
    subject: &Subject<'_>,
    training: &mut Training,
    out: &Path,
    work: &Path,
) -> Result<Vec<ExperimentTable>> {
    if options.experiments.is_empty() {
        return Ok(Vec::new());
    }
    let recipe = subject.recipe();
    let scenes = scenes(options, subject, work)?;
    let measured_on = Conditions {
        data: match subject.folder {
            Some(folder) => name_of(folder),
            None => worlds_in_words(options, scenes.len()),
        },
        frames: scenes.iter().map(|s| s.shots.len()).sum(),
        recipe,
    };
    let mut bench = Bench::new(subject.model, work)?;
    let mut made = Vec::new();
    for choice in &options.experiments {
        for experiment in choice.tables() {
            let bar = progress::spinner(&format!("{experiment:?}"));
            let table = tables::run(experiment, &mut bench, &scenes, recipe)
                .with_context(|| format!("{experiment:?}"))?;
            bar.finish_and_clear();
            made.push(measured_on.told_by(table, Some(subject.model)));
        }
        if let Some(table) = training.table(*choice, &scenes, recipe, work)? {
            made.push(measured_on.told_by(table, None));
        }
        // Each table as soon as it is there: the next may take long.
        made.iter().try_for_each(|table| table.write(out))?;
    }
    Ok(made)
}

fn sweeps(
    options: &ExperimentOptions,
    subject: &Subject<'_>,
    out: &Path,
    work: &Path,
) -> Result<Vec<ExperimentTable>> {
    let flights = options.flights();
    let measured_on = Conditions {
        data: worlds_in_words(options, flights.len()),
        frames: flights.len() * options.world_photos,
        recipe: Recipe::Default,
    };
    let mut bench = Bench::new(subject.model, work)?;
    let mut made = Vec::new();
    for sweep in options.sweeps.iter().flat_map(|s| s.sweeps()) {
        let bar = progress::spinner(&format!("sweep {}", sweep.id()));
        let table =
            sweep::run(sweep, &mut bench, &flights, work).with_context(|| format!("{sweep:?}"))?;
        bar.finish_and_clear();
        let table = measured_on.told_by(table, Some(subject.model));
        table.write(out)?;
        made.push(table);
    }
    Ok(made)
}

/// The data set, each data set of a folder of such, or procedural worlds.
fn scenes(options: &ExperimentOptions, subject: &Subject<'_>, work: &Path) -> Result<Vec<Scene>> {
    let Some(folder) = subject.folder else {
        return options
            .flights()
            .iter()
            .map(|flight| Ok(flight.make(work)?))
            .collect();
    };
    let mut folders: Vec<PathBuf> = fs_err::read_dir(folder)?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| Layout::is_told(path))
        .collect();
    folders.sort();
    if Layout::is_told(folder) || folders.is_empty() {
        folders = vec![folder.to_owned()];
    }
    let read = |folder: &PathBuf| {
        let layout = Layout::find(&LayoutChoice {
            folder: Some(folder),
            world: None,
            out: work,
            map: None,
            place: subject.place,
        })?;
        let map = open_map(&layout.map, &layout.map_options)?;
        let truth = Layout::on_map(layout.truth, map.as_ref())?;
        Ok(Scene::of(
            &name_of(folder),
            map,
            truth,
            subject.footprint_width_m,
        )?)
    };
    folders.iter().map(read).collect()
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(
        || "data".to_owned(),
        |name| name.to_string_lossy().into_owned(),
    )
}

fn worlds_in_words(options: &ExperimentOptions, count: usize) -> String {
    format!(
        "{count} procedural worlds of {:.0} m, seeds from {}, {} photos each",
        options.world_size, options.world_seed, options.world_photos
    )
}

/// What every table of a run has in common.
struct Conditions {
    data: String,
    frames: usize,
    recipe: Recipe,
}

impl Conditions {
    /// The table with its conditions; a table that trains has no one model.
    fn told_by(&self, mut table: ExperimentTable, model: Option<&Model>) -> ExperimentTable {
        let mode = match self.recipe {
            Recipe::Default => "default",
            Recipe::Paper => "paper",
        };
        let hash = model.map(|m| m.hash().to_string().chars().take(12).collect());
        let all = [
            ("data", Some(self.data.clone())),
            ("frames", Some(self.frames.to_string())),
            ("mode", Some(mode.to_owned())),
            ("model", hash),
            (
                "program",
                Some(format!("grim {}", env!("CARGO_PKG_VERSION"))),
            ),
            ("threads", Some(rayon::current_num_threads().to_string())),
        ];
        for (name, value) in all {
            if let Some(value) = value {
                table.conditions.insert(name.to_owned(), value);
            }
        }
        table
    }
}
