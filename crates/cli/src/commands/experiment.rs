//! `grim eval --experiment` and `--sweep`: the paper's tables, and robustness, on any data set or procedural worlds.

mod training;

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, bail};
use grimnet_eval::datasets::{DataSet, DataSetRequest};
use grimnet_eval::pictures::file_name;
use grimnet_eval::scene::Scene;
use grimnet_experiments::bench::Bench;
use grimnet_experiments::experiment_table::ExperimentTable;
use grimnet_experiments::page;
use grimnet_experiments::sweep::{self, Sweep};
use grimnet_experiments::tables::{self, Experiment};
use grimnet_experiments::world_flight::WorldFlight;
use grimnet_net::Model;

use super::experiment_options::{ExperimentChoice, ExperimentOptions, SweepChoice, WORLDS};
use super::map_place::MapPlace;
use crate::exit::Exit;
use crate::progress;
use training::Training;

/// The tables of a choice that need no training.
fn tables_of(choice: ExperimentChoice) -> Vec<Experiment> {
    match choice {
        ExperimentChoice::LossWeights
        | ExperimentChoice::ModulesTrained
        | ExperimentChoice::DaBnTrained => vec![],
        ExperimentChoice::Resolution => vec![Experiment::Resolution],
        ExperimentChoice::Modules => vec![Experiment::Modules],
        ExperimentChoice::TopK => vec![Experiment::TopKRecall, Experiment::TopK],
        ExperimentChoice::Photometry => vec![Experiment::Photometry],
        ExperimentChoice::Methods => vec![Experiment::Methods],
        ExperimentChoice::Success => vec![Experiment::Success],
        ExperimentChoice::DaBn => vec![Experiment::DaBn],
        ExperimentChoice::All => vec![
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

/// The sweeps of a choice.
fn sweeps_of(choice: SweepChoice) -> Vec<Sweep> {
    let one = match choice {
        SweepChoice::Yaw => Sweep::Yaw,
        SweepChoice::Scale => Sweep::Scale,
        SweepChoice::Pitch => Sweep::Pitch,
        SweepChoice::Brightness => Sweep::Brightness,
        SweepChoice::Contrast => Sweep::Contrast,
        SweepChoice::Blur => Sweep::Blur,
        SweepChoice::Noise => Sweep::Noise,
        SweepChoice::Season => Sweep::Season,
        SweepChoice::MapAge => Sweep::MapAge,
        SweepChoice::WrongArea => Sweep::WrongArea,
        SweepChoice::PaperYaw => Sweep::PaperYaw,
        SweepChoice::All => return Sweep::ALL.to_vec(),
    };
    vec![one]
}

/// The flights over the procedural worlds.
fn flights(options: &ExperimentOptions) -> Vec<WorldFlight> {
    WORLDS
        .iter()
        .enumerate()
        .take(options.worlds)
        .map(|(i, &(name, urban))| {
            WorldFlight::over(
                name,
                options.world_seed + i as u64,
                options.world_size,
                urban,
                options.world_photos,
            )
        })
        .collect()
}

/// What the experiments run on, and with.
pub struct Subject<'a> {
    /// A data set, a folder of data sets, or none for procedural worlds.
    pub folder: Option<&'a Path>,
    /// How the maps are placed where they do not tell it.
    pub place: &'a MapPlace,
    /// Width of ground that the photos show, metres, where it is known better than their metadata say.
    pub footprint_width_m: Option<f64>,
    /// The map of every scene that has none of its own.
    pub map: Option<&'a Path>,
    /// The network.
    pub model: &'a Model,
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
        writeln!(stdout, "{}", table.to_markdown(""))?;
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
    let scenes = scenes(options, subject, work)?;
    let measured_on = Conditions {
        data: match subject.folder {
            Some(folder) => file_name(folder),
            None => worlds_in_words(options, scenes.len()),
        },
        frames: scenes.iter().map(|s| s.shots.len()).sum(),
    };
    let mut bench = Bench::new(subject.model, work)?;
    let mut made = Vec::new();
    for choice in &options.experiments {
        for experiment in tables_of(*choice) {
            let bar = progress::spinner(&format!("{experiment:?}"));
            let table = tables::run(experiment, &mut bench, &scenes)
                .with_context(|| format!("{experiment:?}"))?;
            bar.finish_and_clear();
            made.push(measured_on.told_by(table, Some(subject.model)));
        }
        if let Some(table) = training.table(*choice, &scenes, work)? {
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
    let flown = flights(options);
    let measured_on = Conditions {
        data: worlds_in_words(options, flown.len()),
        frames: flown.len() * options.world_photos,
    };
    let mut bench = Bench::new(subject.model, work)?;
    let mut made = Vec::new();
    for sweep in options.sweeps.iter().flat_map(|s| sweeps_of(*s)) {
        let bar = progress::spinner(&format!("sweep {}", sweep.id()));
        let table =
            sweep::run(sweep, &mut bench, &flown, work).with_context(|| format!("{sweep:?}"))?;
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
        return flights(options)
            .iter()
            .map(|flight| Ok(flight.make(work)?))
            .collect();
    };
    let folders = DataSet::scenes(folder)?;
    let unknown = options
        .scene_maps
        .iter()
        .find(|(scene, _)| !folders.iter().any(|f| file_name(f) == *scene));
    if let Some((scene, _)) = unknown {
        let names: Vec<String> = folders.iter().map(|f| file_name(f)).collect();
        bail!(
            "--scene-map {scene}=...: {} has no such scene; it has {}",
            folder.display(),
            names.join(", ")
        );
    }
    folders
        .iter()
        .map(|f| {
            let own = options.scene_maps.iter().find(|(s, _)| file_name(f) == *s);
            let map = own.map(|(_, map)| map.as_path()).or(subject.map);
            read_scene(f, map, subject, work)
        })
        .collect()
}

/// The scene of one data set, named by its folder, with its photos decoded.
fn read_scene(
    folder: &Path,
    map: Option<&Path>,
    subject: &Subject<'_>,
    work: &Path,
) -> Result<Scene> {
    let mut data = DataSet::find(&DataSetRequest {
        folder,
        map,
        map_options: subject.place.options(),
        photos_out: &work.join("photos").join(file_name(folder)),
    })?;
    for (frame, _) in &mut data.frames {
        frame.footprint_width_m = subject.footprint_width_m.or(frame.footprint_width_m);
    }
    let map = data.open_map()?;
    Ok(Scene {
        name: file_name(folder),
        ..data.into_scene(map)?.decoded()?
    })
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
}

impl Conditions {
    /// The table with its conditions; a table that trains has no one model.
    fn told_by(&self, mut table: ExperimentTable, model: Option<&Model>) -> ExperimentTable {
        let hash = model.map(|m| m.hash().to_string().chars().take(12).collect());
        let all = [
            ("data", Some(self.data.clone())),
            ("frames", Some(self.frames.to_string())),
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
