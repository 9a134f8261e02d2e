//! Runs what was asked for, and writes a table each.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, bail};
use grimnet_eval::scene::Scene;
use grimnet_experiments::bench::Bench;
use grimnet_experiments::experiment_table::{self, ExperimentTable};
use grimnet_experiments::gallery_recall::{self, GalleryRecall};
use grimnet_experiments::sweep::{self, Sweep};
use grimnet_experiments::{page, tables};
use grimnet_net::Model;
use grimnet_output::OutputFolder;
use grimnet_photo::pictures::file_name;
use grimnet_program::exit::Exit;
use grimnet_program::progress;

use crate::arguments::Arguments;
use crate::conditions::Conditions;
use crate::named::{Requested, flat};
use crate::scenes::{flights, named_maps, scenes, worlds_in_words};
use crate::training::Training;

/// The page of all sweeps of a run.
const SWEEPS_PAGE: &str = "sweeps.html";

/// The folder of packs and trained networks in the folder of results.
const WORK: &str = "work";

/// What a run reads and where it writes.
struct Session<'a> {
    arguments: &'a Arguments,
    model: &'a Model,
    out: &'a OutputFolder,
    /// Packs and networks, kept for the next run.
    work: &'a Path,
    /// Maps and photos that are only needed during the run.
    scratch: &'a Path,
}

/// Runs what was asked for.
///
/// # Errors
/// Unreadable data, a pack that cannot be built, results that cannot be written.
pub fn run(arguments: &Arguments) -> Result<Exit> {
    let (experiments, sweeps) = (flat(&arguments.experiments), flat(&arguments.sweeps));
    if experiments.is_empty() && sweeps.is_empty() && arguments.distractors.distractors.is_none() {
        bail!("nothing to do: give --experiment, --sweep or --distractors (see --help)");
    }
    let policy = arguments
        .overwrite
        .policy()
        .protect_all(&arguments.model.model)
        .protect_all(&arguments.training.train_config)
        .protect_all(&arguments.training.train_start)
        .protect_all(named_maps(arguments));
    let out = OutputFolder::open(&arguments.out, &policy)?;
    out.check(files(&experiments, &sweeps, arguments))?;
    let work = out.subfolder(WORK)?;
    let scratch = tempfile::tempdir()?;
    let session = Session {
        arguments,
        model: &arguments.model.open()?,
        out: &out,
        work: work.path(),
        scratch: scratch.path(),
    };
    let mut made = session.experiments(&experiments)?;
    made.extend(session.gallery()?);
    let swept = session.sweeps(&sweeps)?;
    if !swept.is_empty() {
        let page = page::page("Accuracy as conditions get worse", &swept)?;
        out.write_bytes(SWEEPS_PAGE, page.as_bytes())?;
    }
    made.extend(swept);
    let mut stdout = std::io::stdout().lock();
    for table in &made {
        writeln!(stdout, "{}", table.to_markdown(""))?;
    }
    Ok(Exit::Done)
}

/// The files that a run writes into the folder of results, as far as they are known before.
fn files(experiments: &[Requested], sweeps: &[Sweep], arguments: &Arguments) -> Vec<String> {
    let gallery = &arguments.distractors.distractors;
    let mut files: Vec<String> = experiments
        .iter()
        .map(|requested| requested.id().to_owned())
        .chain(sweeps.iter().map(|sweep| sweep.table_id()))
        .chain(gallery.iter().map(|_| gallery_recall::ID.to_owned()))
        .flat_map(|id| experiment_table::file_names(&id))
        .collect();
    if !sweeps.is_empty() {
        files.push(SWEEPS_PAGE.to_owned());
    }
    files
}

/// Checks that the ground width of each scene's photos is known: every experiment has rows that are named after it, and without one they
/// would be those of the map's own pixels.
///
/// # Errors
/// A scene without, or a photo that cannot be read.
fn check_ground_widths(scenes: &[Scene]) -> Result<()> {
    for scene in scenes {
        if scene.ground_width_m()?.is_none() {
            bail!(
                "{}: no photo's ground width is known, which rows with scale are given; state it with --footprint-width, or in the column \
                 `footprint_w_m` of a truth.csv",
                scene.name
            );
        }
    }
    Ok(())
}

impl Session<'_> {
    fn experiments(&self, requested: &[Requested]) -> Result<Vec<ExperimentTable>> {
        if requested.is_empty() {
            return Ok(Vec::new());
        }
        let mut training = Training::open(&self.arguments.training, requested, self.work)?;
        let scenes = self.scenes()?;
        check_ground_widths(&scenes)?;
        let conditions = self.conditions(&scenes);
        let mut bench = Bench::new(self.model, self.work)?;
        let mut made = Vec::new();
        for &requested in requested {
            let table = match requested {
                Requested::Measured(experiment) => {
                    let bar = progress::spinner(experiment.id());
                    let table = tables::run(experiment, &mut bench, &scenes)
                        .with_context(|| experiment.id())?;
                    bar.finish_and_clear();
                    conditions.added_to(table, Some(self.model))
                }
                Requested::Trained(experiment) => {
                    let table = training.table(experiment, &scenes, self.work)?;
                    conditions.added_to(table, None)
                }
            };
            // Each table as soon as it is there: the next may take long.
            table.write(self.out)?;
            made.push(table);
        }
        Ok(made)
    }

    fn sweeps(&self, sweeps: &[Sweep]) -> Result<Vec<ExperimentTable>> {
        let worlds = &self.arguments.worlds;
        let flown = flights(worlds);
        let conditions = Conditions {
            data: worlds_in_words(worlds),
            frames: flown.len() * worlds.world_photos,
        };
        let mut bench = Bench::new(self.model, self.work)?;
        let mut made = Vec::new();
        for &sweep in sweeps {
            let bar = progress::spinner(&sweep.table_id());
            let table = sweep::run(sweep, &mut bench, &flown, self.scratch)
                .with_context(|| sweep.table_id())?;
            bar.finish_and_clear();
            let table = conditions.added_to(table, Some(self.model));
            table.write(self.out)?;
            made.push(table);
        }
        Ok(made)
    }

    /// Recall among distractors, if they were given.
    fn gallery(&self) -> Result<Option<ExperimentTable>> {
        let options = &self.arguments.distractors;
        let (Some(distractors), Some(gsd_m)) = (&options.distractors, options.gsd) else {
            return Ok(None);
        };
        let scenes = self.scenes()?;
        let conditions = self.conditions(&scenes);
        let bar = progress::spinner(gallery_recall::ID);
        let recall = GalleryRecall {
            model: self.model,
            distractors,
            gsd_m,
            headings: options.heading,
            packs: self.work,
        };
        let table = recall.table(scenes).context(gallery_recall::ID)?;
        bar.finish_and_clear();
        let table = conditions.added_to(table, Some(self.model));
        table.write(self.out)?;
        Ok(Some(table))
    }

    fn scenes(&self) -> Result<Vec<Scene>> {
        scenes(self.arguments, self.scratch)
    }

    fn conditions(&self, scenes: &[Scene]) -> Conditions {
        Conditions {
            data: match &self.arguments.folder {
                Some(folder) => file_name(folder),
                None => worlds_in_words(&self.arguments.worlds),
            },
            frames: scenes.iter().map(|s| s.shots.len()).sum(),
        }
    }
}
