//! `grim eval`: measure accuracy on photos with a known position.

mod arguments;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use grimnet_eval::datasets::{DataSet, DataSetRequest};
use grimnet_eval::evaluation::{Trial, TrialError};
use grimnet_eval::report::Run;
use grimnet_eval::report::results::{self, About, FILE_NAMES, peak_memory_mib};
use grimnet_eval::retrieval::RetrievalSummary;
use grimnet_eval::scene::{HeadingMode, Scene};
use grimnet_eval::tracks::about::TrackAbout;
use grimnet_eval::tracks::hidden_results::HIDDEN_FILES;
use grimnet_eval::tracks::results::TRACK_FILES;
use grimnet_eval::tracks::town::Town;
use grimnet_geo::Raster;
use grimnet_locate::{HeadingPrior, Localizer, Options, Prior};
use grimnet_net::Model;
use grimnet_output::{OutputFolder, OutputPolicy};
use grimnet_pack::{BuildOptions, Pack};
use tempfile::TempDir;

use super::ModeChoice;
use super::data_set_map::open_map;
use super::elsewhere;
use super::eval_pictures;
use super::eval_run::evaluate_all;
use super::eval_track_flights::{self, TownSearch};
use super::eval_track_hidden;
use super::locate::{AdaptChoice, LocateOptions, adapt_to_flight};
use super::map::build_with_bar;
use super::results::{print_report_path, print_retrieval, print_summary};
use crate::exit::Exit;
use crate::interrupt;
use crate::outputs::OWN_MAGICS;
use crate::procedural_flight::{MAP, draw_map, make_flight};

pub use arguments::EvalArgs;

/// Photos of the procedural flight of `--world`.
const WORLD_PHOTOS: usize = 40;

/// The pack in the folder of results.
const PACK: &str = "area.grim";

/// The retrieval figures in the folder of results.
const RECALL: &str = "recall.json";

/// Where the results go.
struct Results {
    /// Open until the end: no other run writes there, and it goes if nothing was written.
    folder: OutputFolder,
    policy: OutputPolicy,
    pack_path: PathBuf,
}

impl Results {
    /// Opens the folder.
    ///
    /// # Errors
    /// The folder or the pack in it cannot be written.
    fn open(arguments: &EvalArgs) -> Result<Self> {
        let policy = arguments
            .overwrite
            .policy()
            .protect_all(&arguments.model.model)
            .protect_all(&arguments.map);
        let results = Self {
            folder: OutputFolder::open(&arguments.out, &policy)?,
            policy,
            pack_path: arguments.out.join(PACK),
        };
        results.check([])?;
        Ok(results)
    }

    /// Checks that the pack and files of these names may be written: again when more inputs are known.
    ///
    /// # Errors
    /// One of them may not.
    fn check(&self, names: impl IntoIterator<Item = &'static str>) -> Result<()> {
        self.policy.check_file(&self.pack_path, OWN_MAGICS)?;
        Ok(self.folder.check(names)?)
    }
}

/// Runs the command.
///
/// # Errors
/// Unreadable map or truth, nothing to score, results that cannot be written.
pub fn run(arguments: &EvalArgs) -> Result<Exit> {
    check_options(arguments)?;
    // What cannot be written is refused at once, not after the work.
    let results = Results::open(arguments)?;
    if arguments.elsewhere.is_asked() {
        return run_elsewhere(arguments, &results);
    }
    if arguments.track.is_asked() {
        return run_track(arguments, &results);
    }
    let names = || FILE_NAMES.into_iter().chain([RECALL]);
    results.check(names())?;
    // AnyVisLoc's photos are written there, and how the parts of a map lie.
    let scratch = scratch_folder()?;
    let mut data = data_set(arguments, &results.folder, scratch.path())?;
    for (frame, _) in &mut data.frames {
        frame.footprint_width_m = arguments.footprint_width.or(frame.footprint_width_m);
        frame.truth_error_m = frame.truth_error_m.or(arguments.truth_error);
    }
    let map = open_map(&data, &results.policy)?;
    let scene = data.into_scene(map)?;
    warn_of_unknown_headings(arguments, &scene);
    results.check(names())?;
    let matches = results.folder.subfolder("matches")?;
    matches.check(eval_pictures::names(&scene.shots))?;
    let model = arguments.model.open()?;
    let mut localizer = localizer(arguments, &model, scene.map.as_ref(), &results.pack_path)?;
    if arguments.adapt == AdaptChoice::Flight {
        let limits = arguments.limits.photo();
        let paths: Vec<PathBuf> = scene
            .shots
            .iter()
            .filter_map(|shot| shot.photo.path().map(Path::to_owned))
            .collect();
        localizer = adapt_to_flight(localizer, &paths, &Prior::none(), &limits)?;
    }
    let about = about(arguments, &scene, &model, &results.pack_path)?;
    evaluate_and_write(
        arguments,
        &scene,
        &localizer,
        (&results.folder, &matches),
        about,
    )
}

/// Warns of photos whose true heading is not known, if true headings are to be given.
fn warn_of_unknown_headings(arguments: &EvalArgs, scene: &Scene) {
    let headings = scene.shots.iter().map(|shot| shot.known.view.heading);
    let unknown = headings
        .filter(|heading| !matches!(heading, HeadingPrior::Known { .. }))
        .count();
    if unknown > 0 && arguments.heading.contains(&HeadingMode::Known) {
        tracing::warn!(
            "{unknown} of {} photos have no true heading: the run \"{}\" has what their metadata say of it, if anything",
            scene.shots.len(),
            HeadingMode::Known.name()
        );
    }
}

/// Warns of photos that cannot be read, which count as photos without a fix.
fn warn_of_unreadable(trials: &[Trial]) {
    for trial in trials {
        if let Err(TrialError::Photo(error)) = &trial.found {
            tracing::warn!("{error}; counts as a photo without a fix");
        }
    }
}

/// Refuses options that would have no effect.
fn check_options(arguments: &EvalArgs) -> Result<()> {
    let is_elsewhere = arguments.elsewhere.is_asked();
    if arguments.adapt == AdaptChoice::Flight && (is_elsewhere || arguments.track.is_asked()) {
        bail!(
            "--adapt flight takes its statistics from the photos of a data set: it cannot be used with --elsewhere or --track"
        );
    }
    let is_rendered_track = arguments.track.is_asked() && arguments.world.is_some();
    if is_rendered_track && arguments.footprint_width.is_some() {
        bail!("--track flies over --world at heights of its own: leave out --footprint-width");
    }
    if is_rendered_track && arguments.map.is_some() {
        bail!("--track flies over the map that --world draws: leave out --map");
    }
    if arguments.world.is_some() && arguments.map.is_none() && arguments.place.is_given() {
        bail!(
            "--world draws a map that states where it lies: leave out --crs, --corners and --zoom"
        );
    }
    Ok(())
}

/// Runs the evaluation in each heading mode, writes the results and prints the figures.
fn evaluate_and_write(
    arguments: &EvalArgs,
    scene: &Scene,
    localizer: &Localizer,
    (folder, matches): (&OutputFolder, &OutputFolder),
    about: About,
) -> Result<Exit> {
    let mut runs: Vec<Run> = Vec::new();
    let (mut retrievals, mut first_trials) = (Vec::new(), Vec::new());
    for mode in arguments.heading {
        let (run, trials) = evaluate_all(localizer, &scene.shots, *mode, mode.name());
        retrievals.push(RetrievalSummary::of(
            mode.name(),
            localizer.pack(),
            &scene.shots,
            &trials,
            arguments.retrieval.recall_radius,
        ));
        runs.push(run);
        if first_trials.is_empty() {
            first_trials = trials;
        }
    }
    warn_of_unreadable(&first_trials);
    let pictures = eval_pictures::draw(scene, &first_trials, &runs[0].name, matches)?;
    let about = About {
        peak_memory_mib: peak_memory_mib(),
        ..about
    };
    let title = format!("Accuracy on {}", scene.name);
    for (name, content) in results::files(title, &about, &runs, pictures)? {
        folder.write_bytes(name, &content)?;
    }
    let recall_json = serde_json::to_string_pretty(&retrievals)?;
    folder.write_bytes(RECALL, (recall_json + "\n").as_bytes())?;
    print_summary(&runs)?;
    print_retrieval(&retrievals)?;
    print_report_path(folder, &FILE_NAMES)?;
    Ok(Exit::Done)
}

/// A temporary folder, which Ctrl-C removes as well.
fn scratch_folder() -> Result<TempDir> {
    let scratch = tempfile::tempdir()?;
    let path = scratch.path().to_owned();
    interrupt::end_on_interrupt(move || {
        // There is nobody left to tell.
        let _ = fs_err::remove_dir_all(path);
    })?;
    Ok(scratch)
}

/// `grim eval --elsewhere`: photos that are not on the map.
fn run_elsewhere(arguments: &EvalArgs, results: &Results) -> Result<Exit> {
    let policy = &results.policy;
    let scratch = scratch_folder()?;
    let map = match (&arguments.map, &arguments.folder) {
        (Some(map), _) => arguments.place.open(map, policy)?,
        (None, Some(_)) => open_map(
            &data_set(arguments, &results.folder, scratch.path())?,
            policy,
        )?,
        (None, None) => bail!("--elsewhere needs a map: FOLDER with a map.tif, or --map MAP"),
    };
    let sources = arguments.elsewhere.sources()?;
    policy.add_inputs(sources.iter().flat_map(|source| &source.pictures));
    results.check(elsewhere::FILES)?;
    let model = arguments.model.open()?;
    let localizer = localizer(arguments, &model, map.as_ref(), &results.pack_path)?;
    let limits = arguments.limits.photo();
    elsewhere::run(
        &arguments.elsewhere,
        &sources,
        map.as_ref(),
        &localizer,
        &results.folder,
        limits,
    )
}

/// `grim eval --track`: flights instead of single photos.
fn run_track(arguments: &EvalArgs, results: &Results) -> Result<Exit> {
    let model = arguments.model.open()?;
    let about = |data: String| TrackAbout {
        data,
        model_hash: model.hash().to_string(),
        precision: model.precision(),
        commit: arguments.commit.clone(),
        version: env!("CARGO_PKG_VERSION"),
        threads: rayon::current_num_threads(),
    };
    if let Some(seed) = arguments.world {
        results.check(TRACK_FILES)?;
        let search = EvalSearch {
            arguments,
            model: &model,
            policy: &results.policy,
        };
        let about = about(format!("procedural world {seed}"));
        return eval_track_flights::fly(&arguments.track, seed, &search, &results.folder, about);
    }
    let scratch = scratch_folder()?;
    let data = data_set(arguments, &results.folder, scratch.path())?;
    let map = open_map(&data, &results.policy)?;
    results.check(HIDDEN_FILES)?;
    let mut scene = data.into_scene(map)?;
    for shot in &mut scene.shots {
        shot.footprint_width_m = arguments.footprint_width.or(shot.footprint_width_m);
    }
    let localizer = localizer(arguments, &model, scene.map.as_ref(), &results.pack_path)?;
    eval_track_hidden::hide(
        &scene,
        &localizer,
        &results.folder,
        about(scene.name.clone()),
    )
}

/// Searches over a town as the arguments say.
struct EvalSearch<'a> {
    arguments: &'a EvalArgs,
    model: &'a Model,
    policy: &'a OutputPolicy,
}

impl TownSearch for EvalSearch<'_> {
    fn conditions(&self) -> String {
        let EvalArgs {
            mode,
            map_error,
            min_confidence,
            commit,
            adapt,
            retrieval,
            ..
        } = self.arguments;
        format!(
            "version {}, commit {commit:?}, model {} in {}, {mode:?}, map error {map_error} m, least confidence {min_confidence:?}, \
             {adapt:?}, {retrieval:?}",
            env!("CARGO_PKG_VERSION"),
            self.model.hash(),
            self.model.precision()
        )
    }

    fn open(&self, town: &Town, folder: &OutputFolder) -> Result<Arc<Localizer>> {
        draw_map(folder, town)?;
        let options = self.arguments.place.options();
        let map = grimnet_geo::open_map(&folder.path().join(MAP), &options)?;
        let pack_path = folder.path().join(PACK);
        self.policy.check_file(&pack_path, OWN_MAGICS)?;
        let localizer = localizer(self.arguments, self.model, map.as_ref(), &pack_path)?;
        Ok(Arc::new(localizer))
    }
}

/// The data set that was asked for: a folder, or a procedural flight.
fn data_set(arguments: &EvalArgs, out: &OutputFolder, scratch: &Path) -> Result<DataSet> {
    let folder = match (arguments.world, &arguments.folder) {
        (Some(seed), _) => {
            make_flight(out, seed, WORLD_PHOTOS)?;
            arguments.out.clone()
        }
        (None, Some(folder)) => folder.clone(),
        (None, None) => {
            bail!("no FOLDER given: grim eval FOLDER --out DIR; only --world works without one")
        }
    };
    let data = DataSet::find(&DataSetRequest {
        folder: &folder,
        map: arguments.map.as_deref(),
        map_options: arguments.place.options(),
        scratch,
        photo_limits: arguments.limits.photo(),
    })?;
    Ok(match arguments.world {
        Some(seed) => DataSet {
            name: format!("procedural world {seed}"),
            ..data
        },
        None => data,
    })
}

/// Builds the pack of a map and opens a localiser on it.
fn localizer(
    arguments: &EvalArgs,
    model: &Model,
    map: &dyn Raster,
    pack_path: &Path,
) -> Result<Localizer> {
    let options = LocateOptions {
        map_error: arguments.map_error,
        min_confidence: arguments.min_confidence,
        ..LocateOptions::plain(arguments.mode, arguments.adapt)
    };
    let options = Options {
        keep_matches: true,
        ..options.options()?
    };
    options.check_model(model)?;
    let build = BuildOptions {
        levels: arguments.retrieval.levels(),
        ..arguments.mode.build_options()
    };
    build_with_bar(map, model, &build, pack_path)?;
    let pack = Pack::open(pack_path)?;
    Ok(Localizer::builder()
        .model(model.clone())
        .options(options)
        .build(pack)?)
}

/// The conditions of the measurement.
fn about(arguments: &EvalArgs, scene: &Scene, model: &Model, pack_path: &Path) -> Result<About> {
    Ok(About {
        data: scene.name.clone(),
        map: scene.map.describe(),
        mode: match arguments.mode {
            ModeChoice::Default => "default",
            ModeChoice::Paper => "paper",
        }
        .to_owned(),
        model_hash: model.hash().to_string(),
        precision: model.precision(),
        model_calibrated: model.calibration().fitted_on.is_some(),
        calibration: model.calibration().clone(),
        commit: arguments.commit.clone(),
        version: env!("CARGO_PKG_VERSION"),
        map_error_m: arguments.map_error,
        truth_error_m: arguments.truth_error,
        footprint_width_m: arguments.footprint_width,
        min_confidence: arguments.min_confidence,
        adapt: arguments.adapt.to_string(),
        gsd_m: arguments.retrieval.gsd,
        pack_bytes_per_km2: fs_err::metadata(pack_path)?.len() as f64
            / area_km2(scene.map.as_ref()).context("cannot measure the area of the map")?,
        peak_memory_mib: None,
    })
}

/// Area of a map, square kilometres, from the ground resolution in its middle.
fn area_km2(map: &dyn Raster) -> Result<f64> {
    let georeference = map.georeference();
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let (width, height) = map.size_px();
    Ok(width as f64 * x_m * height as f64 * y_m / 1e6)
}
