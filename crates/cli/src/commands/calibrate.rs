//! `grim calibrate`: fit the stated radius and confidence of a model.

mod kept;
mod observing;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use grimnet_answer::printable;
use grimnet_eval::calibration::confidence::ELSEWHERE_ANSWERED;
use grimnet_eval::calibration::observation::Observation;
use grimnet_eval::calibration::real::{NumberedSource, PlacesUsed, RealScene};
use grimnet_eval::calibration::{self, PhotoCount, observation, scenes, trial};
use grimnet_eval::datasets::{DataSet, DataSetError, DataSetRequest};
use grimnet_eval::elsewhere::{ElsewhereOptions, Source};
use grimnet_eval::scene::Scene;
use grimnet_geo::MapOptions;
use grimnet_net::{Calibration, FittedOn, Model};
use grimnet_output::{OutputPolicy, PlannedOutput, check_apart};
use grimnet_photo::PhotoLimits;
use grimnet_photo::pictures::file_name;

use super::data_set_map::open_map;
use super::elsewhere::{pictures, sources, width_m};
use super::{LimitsChoice, ModelChoice};
use crate::exit::Exit;
use crate::formats::stopped;
use crate::outputs::OverwriteChoice;
use crate::standard_output::StandardOutput;
use crate::{inputs, interrupt, progress, values};
use kept::Kept;
use observing::Observing;

/// Arguments of `grim calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    #[command(flatten)]
    model: ModelChoice,

    /// Write the model with its calibration to this file
    ///
    /// While photos are localised, FILE.partial holds the observations so far. Ctrl-C ends the run after the current photo, and the
    /// same command goes on from there.
    #[arg(short, long, value_name = "FILE", value_parser = values::output_file())]
    out: PathBuf,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    /// Procedural worlds to fly over
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = values::world_count)]
    worlds: usize,

    /// Photos of each world or folder
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = values::photo_count)]
    photos: usize,

    /// Seed of the first world
    #[arg(long, default_value_t = 1000)]
    seed: u64,

    /// Folders of nadir pictures from which photos are cut, such as pictures that the model was trained on
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pictures: Vec<PathBuf>,

    /// Assumed ground resolution of the pictures, metres per pixel
    #[arg(long, value_name = "M", default_value_t = 0.15, value_parser = values::gsd_m, allow_hyphen_values = true, requires = "pictures")]
    pictures_gsd: f64,

    /// Data sets whose photos name their place (column `place` of truth.csv); half of the places are used
    ///
    /// The confidence is fitted to them, the stated radius is not: their truth is not exact.
    #[arg(long, value_name = "FOLDER", num_args = 1..)]
    datasets: Vec<PathBuf>,

    /// Which places of the data sets are used, by their number in the order of their names
    #[arg(long, value_name = "HALF", value_enum, default_value_t = PlacesChoice::Odd, requires = "datasets")]
    places: PlacesChoice,

    /// Folders of pictures that are localised on every map and must get no fix
    #[arg(long, value_name = "FOLDER", num_args = 1..)]
    elsewhere: Vec<PathBuf>,

    /// Pictures of each of these folders on each map
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = values::photo_count, requires = "elsewhere")]
    elsewhere_trials: usize,

    /// Share of photos taken elsewhere that may get a fix; a smaller share costs right fixes
    #[arg(long, value_name = "SHARE", default_value_t = ELSEWHERE_ANSWERED, value_parser = values::inner_share, allow_hyphen_values = true)]
    elsewhere_answered: f64,

    /// Description of the data in the model file, instead of the command's own
    #[arg(long, value_name = "TEXT")]
    data: Option<String>,

    /// Fit one part only and keep the other as the model has it
    #[arg(long, value_name = "PART", value_enum)]
    only: Option<PartChoice>,

    /// Also write the observations, one line per photo
    #[arg(long, value_name = "FILE.csv", value_parser = values::output_file())]
    observations: Option<PathBuf>,

    /// Fit to the observations of an earlier run with the same model
    #[arg(
        long,
        value_name = "FILE.csv",
        conflicts_with_all = ["observations", "worlds", "photos", "seed", "pictures", "datasets", "elsewhere"]
    )]
    observed: Option<PathBuf>,

    #[command(flatten)]
    limits: LimitsChoice,
}

/// Runs the command.
///
/// # Errors
/// Unreadable model or pictures, too few right answers to fit anything, a file that cannot be written.
pub fn run(arguments: &CalibrateArgs) -> Result<Exit> {
    let policy = arguments
        .overwrite
        .policy()
        .protect_all(&arguments.model.model)
        .protect_all(&arguments.observed);
    check_outputs(arguments, &policy)?;
    let model = arguments.model.open()?;
    let observed = match &arguments.observed {
        Some(path) => {
            inputs::check_regular(path)?;
            let observations = observation::read(path).with_context(|| {
                format!(
                    "cannot read {}; expected a file that `grim calibrate --observations` wrote",
                    path.display()
                )
            })?;
            Observed {
                observations,
                data: "observations of an earlier run".to_owned(),
                kept: None,
            }
        }
        None => match observe(arguments, &model, &policy)? {
            Some(observed) => observed,
            None => return Ok(Exit::Interrupted),
        },
    };
    let kept = observed.kept.as_ref().map(|kept| kept.path().to_owned());
    fit_and_write(arguments, &model, &policy, observed)
        .map_err(|error| stopped(error, "the observations are kept in", kept))?;
    Ok(Exit::Done)
}

/// The observations of a run.
struct Observed {
    observations: Vec<Observation>,
    /// What they are of, in words.
    data: String,
    /// Where they are kept until the model is written.
    kept: Option<Kept>,
}

/// Fits the calibration, writes the model with it and prints it.
fn fit_and_write(
    arguments: &CalibrateArgs,
    model: &Model,
    policy: &OutputPolicy,
    observed: Observed,
) -> Result<()> {
    let observations = observed.observations;
    if let Some(path) = &arguments.observations {
        policy.write(path, |file| {
            observation::write(file, &observations).map_err(std::io::Error::other)
        })?;
    }
    let data = arguments.data.as_ref().unwrap_or(&observed.data);
    let fitted = calibration::fit(&observations, data, arguments.elsewhere_answered)?;
    let calibration = merged(model.calibration(), fitted, arguments.only);
    let calibrated = model.with_calibration(calibration.clone())?;
    policy.write(&arguments.out, |file| calibrated.write(file))?;
    if let Some(kept) = observed.kept {
        kept.remove()?;
    }
    let mut out = StandardOutput;
    writeln!(out, "{}", serde_json::to_string_pretty(&calibration)?)?;
    writeln!(
        out,
        "{}: written; the identity of the model does not change and its packs stay valid",
        printable(&arguments.out.display().to_string())
    )?;
    Ok(())
}

/// Checks that the outputs do not meet and may be written: again when more inputs are known.
fn check_outputs(arguments: &CalibrateArgs, policy: &OutputPolicy) -> Result<()> {
    let observations = arguments.observations.iter();
    let outputs: Vec<(&str, &PathBuf)> = std::iter::once(("--out", &arguments.out))
        .chain(observations.map(|path| ("--observations", path)))
        .collect();
    let planned = outputs
        .iter()
        .map(|(option, path)| PlannedOutput::file(option, path));
    check_apart(&planned.collect::<Vec<_>>())?;
    for (_, path) in outputs {
        policy.check_file(path, &[])?;
    }
    Ok(())
}

/// One part of a calibration.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PartChoice {
    /// The probability that a fix is right, and the least that is required
    Confidence,
    /// The stated radius
    Position,
}

/// The fitted calibration, with the other part of `kept` where only one is wanted. Figures of a part that is kept are those of its own
/// fit, or zero if it was never fitted.
fn merged(kept: &Calibration, fitted: Calibration, only: Option<PartChoice>) -> Calibration {
    let kept_on = kept.fitted_on.clone().unwrap_or_default();
    match only {
        None => fitted,
        Some(PartChoice::Confidence) => Calibration {
            position: kept.position,
            fitted_on: fitted.fitted_on.map(|on| FittedOn {
                data: format!("the confidence alone: {}", on.data),
                fixes: kept_on.fixes,
                held_out_coverage_95: kept_on.held_out_coverage_95,
                ..on
            }),
            ..fitted
        },
        Some(PartChoice::Position) => Calibration {
            confidence: kept.confidence,
            fitted_on: fitted.fitted_on.map(|on| FittedOn {
                data: format!("the stated radius alone: {}", on.data),
                elsewhere: kept_on.elsewhere,
                held_out_availability: kept_on.held_out_availability,
                held_out_elsewhere: kept_on.held_out_elsewhere,
                held_out_elsewhere_answered: kept_on.held_out_elsewhere_answered,
                ..on
            }),
            ..fitted
        },
    }
}

/// Which half of the places of a data set is used.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PlacesChoice {
    /// The first, the third and so on
    Odd,
    /// The second, the fourth and so on
    Even,
}

impl From<PlacesChoice> for PlacesUsed {
    fn from(choice: PlacesChoice) -> Self {
        match choice {
            PlacesChoice::Odd => Self::Odd,
            PlacesChoice::Even => Self::Even,
        }
    }
}

/// Reads the data set in a folder, whose files become inputs of `policy`. Gives them as well.
fn data_set(
    folder: &Path,
    scratch: &Path,
    photo_limits: PhotoLimits,
    policy: &OutputPolicy,
) -> Result<(Scene, Vec<PathBuf>)> {
    let set = DataSet::find(&DataSetRequest {
        folder,
        map: None,
        map_options: MapOptions::default(),
        scratch,
        photo_limits,
    })
    .map_err(|error| match error {
        // Another map would not help: only a truth.csv names places.
        DataSetError::MsdiNeedsMap(_) | DataSetError::UnknownLayout(_) => without_places(folder),
        error => error.into(),
    })?;
    let map = open_map(&set, policy)?;
    // What is written for this run is as the files that it comes from.
    let all = set.files().map(Path::to_owned).chain(map.files());
    let files = all.filter(|path| !path.starts_with(scratch)).collect();
    Ok((set.into_scene(map)?, files))
}

/// The error of a data set of which no photo is used.
fn without_places(folder: &Path) -> anyhow::Error {
    anyhow!(
        "{}: no answerable photo of half of its places: its truth.csv needs a column `place`, with two places at least",
        folder.display()
    )
}

/// Makes the scenes and localises their photos. All files that are read become inputs of `policy`. `None` if Ctrl-C ended it.
fn observe(
    arguments: &CalibrateArgs,
    model: &Model,
    policy: &OutputPolicy,
) -> Result<Option<Observed>> {
    let elsewhere = arguments.elsewhere.iter().map(|folder| (folder, true));
    let sources = sources(&elsewhere.collect::<Vec<_>>())?;
    let of_sources = sources.iter().flat_map(|source| source.pictures.clone());
    let mut files: Vec<PathBuf> = of_sources.collect();
    for folder in &arguments.pictures {
        files.extend(pictures(folder)?);
    }
    policy.add_inputs(&files);
    let folder = tempfile::tempdir()?;
    let limits = arguments.limits.photo();
    let mut sets = Vec::new();
    for set in &arguments.datasets {
        let (scene, of_set) = data_set(set, folder.path(), limits, policy)?;
        sets.push(scene);
        files.extend(of_set);
    }
    check_outputs(arguments, policy)?;
    let kept_path = kept::path_for(&arguments.out, policy)?;
    if let (Some(kept), Some(written)) = (&kept_path, &arguments.observations) {
        check_apart(&[
            PlannedOutput::file("--out", kept),
            PlannedOutput::file("--observations", written),
        ])?;
    }
    for (scene, set) in sets.iter().zip(&arguments.datasets) {
        if !PlacesUsed::from(arguments.places).has_photos(scene) {
            return Err(without_places(set));
        }
    }
    let conditions = conditions(arguments, model, &files)?;
    let stop = Arc::new(AtomicBool::new(false));
    interrupt::stop_on_interrupt(&stop)?;
    let Some(made) = draw_scenes(arguments, folder.path(), &stop)? else {
        tracing::warn!("interrupted before the first photo; nothing is kept");
        return Ok(None);
    };
    let real = real_scenes(arguments, &made, &sets, sources)?;
    let count = trial::count(&made) + real.iter().map(RealScene::count).sum::<PhotoCount>();
    // Observations that are written may be fitted with others.
    if arguments.observations.is_none() {
        count
            .check_enough()
            .context("too few photos, even if all are found")?;
    }
    let observing = Observing {
        out: &arguments.out,
        kept_path,
        conditions,
        count: count.here + count.elsewhere,
        stop,
    };
    let observed = observing.run(&mut |observer| {
        trial::observe(model, &made, folder.path(), observer)?;
        // The made scenes come first, as they do in `trial::observe`, so that their packs are there already.
        for (number, scene) in real.iter().enumerate() {
            let pack = trial::pack_path(folder.path(), number);
            scene.observe(model, made.len(), pack, observer)?;
        }
        Ok(())
    })?;
    Ok(observed.map(|(observations, kept)| Observed {
        observations,
        data: description(arguments, &made, &sets),
        kept,
    }))
}

/// What is localised on the map of each scene beside the photos of made scenes: pictures that are not on it, and the photos of data
/// sets. The scenes that are made come first.
fn real_scenes<'a>(
    arguments: &CalibrateArgs,
    made: &'a [Scene],
    sets: &'a [Scene],
    sources: Vec<Source>,
) -> Result<Vec<RealScene<'a>>> {
    let sources = numbered(arguments, made.len(), sources);
    // A picture must not be on the map: the sources of each scene are those that its map was not made of.
    let folders = vec![None; arguments.worlds]
        .into_iter()
        .chain(arguments.pictures.iter().map(Some));
    let of_made = made
        .iter()
        .zip(folders)
        .map(|(scene, folder)| (scene, folder, None));
    let places: Option<PlacesUsed> = Some(arguments.places.into());
    let of_sets = sets
        .iter()
        .zip(&arguments.datasets)
        .map(|(scene, set)| (scene, Some(set), places));
    of_made
        .chain(of_sets)
        .zip(0..)
        .map(|((scene, folder, places), number)| {
            Ok(RealScene {
                scene,
                places,
                elsewhere: sources_outside(&sources, folder),
                trials: ElsewhereOptions {
                    trials: arguments.elsewhere_trials,
                    seed: arguments.seed + number,
                    map_width_m: width_m(scene.map.as_ref())?,
                    nothing_given: false,
                    photo_limits: arguments.limits.photo(),
                },
            })
        })
        .collect()
}

/// The sources with the numbers of their scenes, of which the first `made` are in use: photos cut from the same pictures are of the
/// same scene.
fn numbered(arguments: &CalibrateArgs, made: usize, sources: Vec<Source>) -> Vec<NumberedSource> {
    let with_scene = |(source, number): (Source, usize)| {
        let mut folders = arguments.pictures.iter();
        let cut = folders.position(|folder| is_within(&source, folder));
        let scene = cut.map_or(made + number, |i| arguments.worlds + i);
        NumberedSource { source, scene }
    };
    sources.into_iter().zip(0..).map(with_scene).collect()
}

/// What the observations depend on, in words: every setting, and the state of every file.
fn conditions(arguments: &CalibrateArgs, model: &Model, files: &[PathBuf]) -> Result<String> {
    let CalibrateArgs {
        worlds,
        photos,
        seed,
        pictures,
        pictures_gsd,
        datasets,
        places,
        elsewhere,
        elsewhere_trials,
        limits,
        ..
    } = arguments;
    let mut text = format!(
        "version {}, model {} in {}, {}, {worlds} worlds, {photos} photos, seed {seed}, {pictures:?} at {pictures_gsd}, {places:?} \
         places of {datasets:?}, {elsewhere_trials} of {elsewhere:?}, {limits:?}\n",
        env!("CARGO_PKG_VERSION"),
        model.hash(),
        model.precision(),
        serde_json::to_string(model.calibration())?,
    );
    for file in files {
        text += &kept::state_of(file);
    }
    Ok(text)
}

/// Draws the procedural worlds, and cuts photos from the pictures, with their maps in `folder`. `None` if Ctrl-C ended it.
fn draw_scenes(
    arguments: &CalibrateArgs,
    folder: &Path,
    stop: &AtomicBool,
) -> Result<Option<Vec<Scene>>> {
    if arguments.worlds + arguments.pictures.len() < 2 {
        bail!(
            "at least two worlds or folders of pictures are required: photos of one are localised on the map of the other"
        );
    }
    let bar = progress::bar(
        (arguments.worlds + arguments.pictures.len()) as u64,
        "drawing maps and photos",
        "scenes",
    );
    let worlds = (arguments.seed..)
        .take(arguments.worlds)
        .map(|seed| scenes::world(seed, arguments.photos, folder));
    let of_pictures = (0..).zip(&arguments.pictures).map(|(seed, pictures)| {
        scenes::pictures(
            pictures,
            arguments.pictures_gsd,
            arguments.photos,
            seed,
            folder,
        )
    });
    let mut made = Vec::new();
    for scene in worlds.chain(of_pictures) {
        made.push(scene?);
        bar.inc(1);
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
    }
    bar.finish_and_clear();
    Ok(Some(made))
}

/// The sources whose pictures are not those of `folder`.
fn sources_outside(sources: &[NumberedSource], folder: Option<&PathBuf>) -> Vec<NumberedSource> {
    let is_outside = |numbered: &&NumberedSource| {
        folder.is_none_or(|folder| !is_within(&numbered.source, folder))
    };
    sources.iter().filter(is_outside).cloned().collect()
}

/// Whether a picture of a source lies in a folder, however the two are written.
fn is_within(source: &Source, folder: &Path) -> bool {
    let resolved = |path: &Path| fs_err::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let folder = resolved(folder);
    let mut pictures = source.pictures.iter();
    pictures.any(|path| resolved(path).starts_with(&folder))
}

/// What the calibration is fitted to, in words.
fn description(arguments: &CalibrateArgs, made: &[Scene], sets: &[Scene]) -> String {
    let names: Vec<&str> = made.iter().map(|scene| scene.name.as_str()).collect();
    let mut text = format!(
        "{} photos each of: {}; every photo also localised on the map of another",
        arguments.photos,
        names.join(", ")
    );
    if !sets.is_empty() {
        let names: Vec<&str> = sets.iter().map(|scene| scene.name.as_str()).collect();
        let half = match arguments.places {
            PlacesChoice::Odd => "first, third, ...",
            PlacesChoice::Even => "second, fourth, ...",
        };
        text += &format!(
            "; photos of half of the places ({half}) of: {}",
            names.join(", ")
        );
    }
    if !arguments.elsewhere.is_empty() {
        let folders: Vec<String> = arguments.elsewhere.iter().map(|f| file_name(f)).collect();
        text += &format!(
            "; on each map, {} pictures each that are not on it, of: {}",
            arguments.elsewhere_trials,
            folders.join(", ")
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use grimnet_net::PositionError;

    use super::*;

    /// A calibration of which every figure of its fit is `figure`.
    fn calibration(figure: u32) -> Calibration {
        let (count, share) = (figure as usize, f64::from(figure) / 10.0);
        Calibration {
            position: PositionError {
                inlier_factor: f64::from(figure),
                shared_px: 1.0,
            },
            confidence: None,
            fitted_on: Some(FittedOn {
                data: format!("run {figure}"),
                photos: count,
                fixes: count,
                elsewhere: count,
                held_out_coverage_95: share,
                held_out_availability: share,
                held_out_elsewhere: count,
                held_out_elsewhere_answered: count,
            }),
        }
    }

    #[test]
    fn a_part_that_is_kept_keeps_the_figures_of_its_fit() {
        let (kept, fitted) = (calibration(1), || calibration(2));
        let confidence = merged(&kept, fitted(), Some(PartChoice::Confidence));
        assert_eq!(confidence.position, kept.position);
        let on = confidence.fitted_on.unwrap();
        assert_eq!(on.data, "the confidence alone: run 2");
        assert_eq!((on.fixes, on.held_out_coverage_95), (1, 0.1));
        assert_eq!((on.photos, on.held_out_elsewhere), (2, 2));

        let position = merged(&kept, fitted(), Some(PartChoice::Position));
        let on = position.fitted_on.unwrap();
        assert_eq!((on.fixes, on.held_out_coverage_95), (2, 0.2));
        assert_eq!((on.held_out_availability, on.held_out_elsewhere), (0.1, 1));
        assert_eq!((on.photos, on.elsewhere), (2, 1));

        let of_none = Calibration::default();
        let confidence = merged(&of_none, fitted(), Some(PartChoice::Confidence));
        let on = confidence.fitted_on.unwrap();
        assert_eq!((on.fixes, on.held_out_coverage_95), (0, 0.0));
    }
}
