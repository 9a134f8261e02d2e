//! `grim eval --experiment` and `--sweep`: the paper's tables, and robustness, on any data set or the procedural world.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use grimnet_eval::experiment::bench::Bench;
use grimnet_eval::experiment::flight::WorldFlight;
use grimnet_eval::experiment::page;
use grimnet_eval::experiment::scene::Scene;
use grimnet_eval::experiment::sweep::{self, Sweep};
use grimnet_eval::experiment::tables::{self, Experiment, Recipe};
use grimnet_eval::experiment_table::ExperimentTable;
use grimnet_net::Model;

use super::ModeChoice;
use crate::exit::Exit;
use crate::progress;

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
    /// All of these
    All,
}

impl ExperimentChoice {
    fn tables(self) -> Vec<Experiment> {
        match self {
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

/// Runs what was asked for and writes a table each, as JSON, CSV and Markdown, into `out`.
///
/// # Errors
/// Unreadable data, a pack that cannot be built, results that cannot be written.
pub fn run(
    options: &ExperimentOptions,
    folder: Option<&Path>,
    footprint_width_m: Option<f64>,
    mode: ModeChoice,
    model: &Model,
    out: &Path,
) -> Result<Exit> {
    let work = out.join("work");
    fs_err::create_dir_all(&work)?;
    let mut bench = Bench::new(model, &work)?;
    let recipe = match mode {
        ModeChoice::Default => Recipe::Default,
        ModeChoice::Paper => Recipe::Paper,
    };
    let mut made = Vec::new();
    let experiments: Vec<Experiment> = options
        .experiments
        .iter()
        .flat_map(|e| e.tables())
        .collect();
    if !experiments.is_empty() {
        let scenes = scenes(options, folder, footprint_width_m, &work)?;
        let bar = progress::bar(experiments.len() as u64, "experiments", "tables");
        let frames: usize = scenes.iter().map(|s| s.shots.len()).sum();
        let data = match folder {
            Some(folder) => folder
                .file_name()
                .map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
            None => worlds_in_words(options, scenes.len()),
        };
        for experiment in experiments {
            let mut table = tables::run(experiment, &mut bench, &scenes, recipe)
                .with_context(|| format!("{experiment:?}"))?;
            conditions(&mut table, model, &data, frames, recipe);
            table.write(out)?;
            made.push(table);
            bar.inc(1);
        }
        bar.finish_and_clear();
    }
    let sweeps: Vec<Sweep> = options.sweeps.iter().flat_map(|s| s.sweeps()).collect();
    let bar = progress::bar(sweeps.len() as u64, "sweeps", "tables");
    let flights = options.flights();
    let mut swept = Vec::new();
    for sweep in sweeps {
        let mut table =
            sweep::run(sweep, &mut bench, &flights, &work).with_context(|| format!("{sweep:?}"))?;
        let data = worlds_in_words(options, flights.len());
        conditions(
            &mut table,
            model,
            &data,
            flights.len() * options.world_photos,
            Recipe::Default,
        );
        table.write(out)?;
        swept.push(table);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if !swept.is_empty() {
        let title = "Accuracy as conditions get worse";
        fs_err::write(out.join("sweeps.html"), page::page(title, &swept)?)?;
    }
    made.extend(swept);
    let mut stdout = std::io::stdout().lock();
    for table in &made {
        writeln!(stdout, "{}", table.to_markdown())?;
    }
    Ok(Exit::Done)
}

fn scenes(
    options: &ExperimentOptions,
    folder: Option<&Path>,
    footprint_width_m: Option<f64>,
    work: &Path,
) -> Result<Vec<Scene>> {
    if let Some(folder) = folder {
        return Ok(Scene::read_all(folder, footprint_width_m)?);
    }
    let flights = options.flights();
    let bar = progress::bar(flights.len() as u64, "drawing the worlds", "worlds");
    let scenes: Result<Vec<Scene>> = flights
        .iter()
        .map(|flight| {
            let scene = flight.make(work)?;
            bar.inc(1);
            Ok(scene)
        })
        .collect();
    bar.finish_and_clear();
    scenes
}

fn worlds_in_words(options: &ExperimentOptions, count: usize) -> String {
    format!(
        "{count} procedural worlds of {:.0} m, seeds from {}, {} photos each",
        options.world_size, options.world_seed, options.world_photos
    )
}

fn conditions(
    table: &mut ExperimentTable,
    model: &Model,
    data: &str,
    frames: usize,
    recipe: Recipe,
) {
    let mode = match recipe {
        Recipe::Default => "default",
        Recipe::Paper => "paper",
    };
    for (name, value) in [
        ("data", data.to_owned()),
        ("frames", frames.to_string()),
        ("mode", mode.to_owned()),
        ("model", model.hash().to_string().chars().take(12).collect()),
        ("program", format!("grim {}", env!("CARGO_PKG_VERSION"))),
        ("threads", rayon::current_num_threads().to_string()),
    ] {
        table.conditions.insert(name.to_owned(), value);
    }
}
