//! `grim eval`: measure accuracy on photos whose place is known.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, ValueEnum};
use grimnet_eval::metrics::{Frame, Summary};
use grimnet_eval::report::Run;
use grimnet_eval::truth::TruthFrame;
use grimnet_geo::{LonLat, MapPx, Raster, open_map};
use grimnet_locate::{DEFAULT_MAP_ERROR_M, Localizer, Options, Prior, Trace};
use grimnet_output::OutputFolder;
use grimnet_pack::{BuildOptions, Pack};

use super::eval_layout::{Layout, LayoutChoice};
use super::eval_pictures::{self, Drawn};
#[cfg(feature = "experiments")]
use super::experiment::{self, Subject};
use super::experiment_options::ExperimentOptions;
use super::gallery::{GalleryOptions, RunRecall, print_recall};
use super::locate::{AdaptChoice, LocateOptions, adapt_to_flight, locate_one_traced};
use super::map::{MapPlace, build_with_bar};
use super::results::{About, peak_memory_mib, print_summary, write_results};
use super::{ModeChoice, ModelChoice};
use crate::answer::Answer;
use crate::exit::Exit;
use crate::outputs::{OWN_MAGICS, OverwriteChoice};
use crate::{errors, progress, values};

/// The true heading is given to the localiser with this uncertainty, degrees (1 sigma).
const TRUE_HEADING_SIGMA_DEG: f64 = 5.0;

/// Files in the folder of results, beside the pack.
const FILES: [&str; 5] = [
    "summary.json",
    "report.html",
    "frames.csv",
    "failed.jsonl",
    "recall.json",
];

/// Whether the truth file's headings are given to the localiser.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum HeadingMode {
    /// Both ways, one after the other
    #[default]
    Both,
    /// From the truth file
    Known,
    /// Searched
    Unknown,
    /// From the photos' metadata
    Exif,
}

impl HeadingMode {
    fn runs(self) -> &'static [Self] {
        match self {
            Self::Both => &[Self::Known, Self::Unknown],
            Self::Known => &[Self::Known],
            Self::Unknown => &[Self::Unknown],
            Self::Exif => &[Self::Exif],
        }
    }

    /// What tables call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Both => "both",
            Self::Known => "heading known",
            Self::Unknown => "heading unknown",
            Self::Exif => "heading from the photo",
        }
    }
}

/// Arguments of `grim eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// A folder with map.tif, photos/ and truth.csv, or a scene of UAV-VisLoc or AnyVisLoc, or photos whose EXIF tells where
    /// they were taken, such as MSDI's (with --map)
    ///
    /// truth.csv has the columns photo, lat_deg, lon_deg (of the image centre; or centre_lat, centre_lon), and, where known,
    /// heading_deg, gps_lat, gps_lon. Of UAV-VisLoc give the folder of one scene, such as UAV-VisLoc/03, of
    /// AnyVisLoc likewise, such as AnyVisLoc/Scene_01; --map satellite_map.png takes its satellite map. Of MSDI give the
    /// whole or one scene of its calibrated_images.
    folder: Option<PathBuf>,

    /// Draw the procedural world of this seed and a flight over it, and localise that
    #[arg(long, value_name = "SEED", conflicts_with = "folder")]
    world: Option<u64>,

    /// Folder for summary.json, report.html, frames.csv, failed.jsonl and the pack
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    /// The map, where it is not FOLDER/map.tif
    #[arg(long, value_name = "MAP")]
    map: Option<PathBuf>,

    #[command(flatten)]
    place: MapPlace,

    #[command(flatten)]
    model: ModelChoice,

    /// Whether the localiser is told the true headings
    #[arg(long = "heading", value_enum, default_value_t)]
    heading_mode: HeadingMode,

    /// Commit that this program was built from, to be kept with the figures
    #[arg(long, value_name = "HASH")]
    commit: Option<String>,

    /// Width of ground that the photos show, metres, where it is known better than their metadata say
    #[arg(long, value_name = "M", value_parser = values::length_m, allow_hyphen_values = true)]
    footprint_width: Option<f64>,

    /// Which recipe to follow
    #[arg(long, value_enum, default_value_t)]
    mode: ModeChoice,

    /// How far the map itself may lie beside the truth, metres (1 sigma per axis); the stated radius includes it
    #[arg(
        long,
        value_name = "M",
        value_parser = values::sigma_m,
        allow_hyphen_values = true,
        default_value_t = DEFAULT_MAP_ERROR_M
    )]
    map_error: f64,

    /// How well the truth itself is known, metres (1 sigma per axis): the share of radii that hold is also given with it
    #[arg(long, value_name = "M", value_parser = values::sigma_m, allow_hyphen_values = true)]
    truth_error: Option<f64>,

    /// Take the normalisation statistics anew
    #[arg(long, value_enum, default_value_t)]
    adapt: AdaptChoice,

    #[command(flatten)]
    gallery: GalleryOptions,

    #[command(flatten)]
    experiment: ExperimentOptions,
}

/// Runs the command.
///
/// # Errors
/// Unreadable map or truth, nothing to score, results that cannot be written.
pub fn run(arguments: &EvalArgs) -> Result<Exit> {
    arguments.experiment.check_present()?;
    #[cfg(feature = "experiments")]
    if arguments.experiment.is_asked() {
        let subject = Subject {
            folder: arguments.folder.as_deref(),
            place: &arguments.place,
            footprint_width_m: arguments.footprint_width,
            mode: arguments.mode,
            model: &arguments.model.open()?,
        };
        return experiment::run(&arguments.experiment, &subject, &arguments.out);
    }
    let policy = arguments
        .overwrite
        .policy()
        .protect_all(&arguments.model.model);
    // Refused at once, not after the work.
    OutputFolder::open(&arguments.out, &policy)?.check(FILES)?;
    let pack_path = arguments.out.join("area.grim");
    policy.check_file(&pack_path, OWN_MAGICS)?;
    let layout = Layout::find(&LayoutChoice {
        folder: arguments.folder.as_deref(),
        world: arguments.world,
        out: &arguments.out,
        policy: &policy,
        map: arguments.map.as_deref(),
        place: &arguments.place,
    })?;
    let (truth, data) = (layout.truth, layout.data);
    let policy = policy
        .protect(&layout.map)
        .protect_all(truth.iter().map(|(_, path)| path));
    let folder = OutputFolder::open(&arguments.out, &policy)?;
    let matches = folder.subfolder("matches")?;
    let map = arguments
        .gallery
        .lay_out(open_map(&layout.map, &layout.map_options)?)?;
    let truth = Layout::on_map(truth, map.as_ref())?;
    let model = arguments.model.open()?;
    let build = match arguments.mode {
        ModeChoice::Default => BuildOptions::standard(),
        ModeChoice::Paper => BuildOptions::paper(),
    };
    let build = BuildOptions {
        levels: arguments.gallery.levels(),
        ..build
    };
    build_with_bar(map.as_ref(), &model, &build, &pack_path)?;

    let options = LocateOptions {
        map_error: arguments.map_error,
        ..LocateOptions::plain(arguments.mode, arguments.adapt)
    };
    let model_hash = model.hash().to_string();
    let model_calibrated = model.calibration().fitted_on.is_some();
    let mut localizer = Localizer::new(model, Pack::open(&pack_path)?)?.with_options(Options {
        keep_matches: true,
        ..options.options()
    });
    let paths: Vec<PathBuf> = truth.iter().map(|t| t.1.clone()).collect();
    if arguments.adapt == AdaptChoice::Flight {
        localizer = adapt_to_flight(localizer, &paths, &Prior::none())?;
    }
    let (mut runs, mut recalls) = (Vec::new(), Vec::new());
    let mut first_answers = Vec::new();
    for mode in arguments.heading_mode.runs() {
        let (answers, traces) = locate_all(&localizer, &truth, *mode, arguments.footprint_width)?;
        if first_answers.is_empty() {
            first_answers.clone_from(&answers);
        }
        runs.push(score_with(
            mode.name(),
            &answers,
            &truth,
            arguments.truth_error,
        ));
        let tried = traces.iter().zip(truth.iter().map(|t| &t.0));
        let radius_px = arguments.gallery.recall_radius;
        recalls.push(RunRecall::of(
            mode.name(),
            localizer.pack(),
            tried,
            radius_px,
        ));
    }
    let pictures = eval_pictures::draw(&Drawn {
        localizer: &localizer,
        map: map.as_ref(),
        truth: &truth,
        answers: &first_answers,
        run: &runs[0],
        folder: &matches,
        prior_of: &|frame, path| {
            prior(
                arguments.heading_mode.runs()[0],
                frame,
                path,
                arguments.footprint_width,
            )
        },
    })?;
    let about = About {
        data: data.clone(),
        mode: match arguments.mode {
            ModeChoice::Default => "default",
            ModeChoice::Paper => "paper",
        }
        .to_owned(),
        model_hash,
        model_calibrated,
        commit: arguments.commit.clone(),
        version: env!("CARGO_PKG_VERSION"),
        map_error_m: arguments.map_error,
        truth_error_m: arguments.truth_error,
        footprint_width_m: arguments.footprint_width,
        pack_bytes_per_km2: fs_err::metadata(&pack_path)?.len() as f64 / area_km2(map.as_ref())?,
        peak_memory_mib: peak_memory_mib(),
    };
    let title = format!("Accuracy on {data}");
    write_results(&folder, title, &about, &runs, pictures)?;
    let recall_json = serde_json::to_string_pretty(&recalls)?;
    folder.write_bytes("recall.json", (recall_json + "\n").as_bytes())?;
    print_summary(&runs)?;
    print_recall(&recalls)?;
    Ok(Exit::Done)
}

/// What the localiser is told of one photo.
fn prior(
    mode: HeadingMode,
    frame: &TruthFrame,
    path: &Path,
    footprint_width_m: Option<f64>,
) -> Prior {
    let prior = match (mode, frame.heading_deg) {
        (HeadingMode::Unknown, _) => Prior::none().with_unknown_heading(),
        (HeadingMode::Known, Some(heading)) => {
            Prior::none().with_heading(heading, TRUE_HEADING_SIGMA_DEG)
        }
        _ => Prior::none(),
    };
    match footprint_width_m {
        Some(width_m) => {
            prior.with_gsd_m(width_m / f64::from(image::image_dimensions(path).map_or(1, |d| d.0)))
        }
        None => prior,
    }
}

/// Area of a map, square kilometres, by the ground resolution in its middle.
fn area_km2(map: &dyn Raster) -> Result<f64> {
    let (width, height) = map.size_px();
    let georeference = map.georeference();
    let middle = MapPx {
        x: width as f64 / 2.0,
        y: height as f64 / 2.0,
    };
    let (x_m, y_m) = georeference.ground_resolution_m(middle)?;
    Ok(width as f64 * x_m * height as f64 * y_m / 1e6)
}

/// Localises every photo under a progress bar: the answers, and what was tried for each.
///
/// # Errors
/// Never for a single photo: it then has no fix, with the error as its reason.
pub fn locate_all(
    localizer: &Localizer,
    truth: &[(TruthFrame, PathBuf)],
    mode: HeadingMode,
    footprint_width_m: Option<f64>,
) -> Result<(Vec<Answer>, Vec<Trace>)> {
    let bar = progress::bar(truth.len() as u64, mode.name(), "photos");
    let mut answers = Vec::with_capacity(truth.len());
    let mut traces = Vec::with_capacity(truth.len());
    for (frame, path) in truth {
        let prior = prior(mode, frame, path, footprint_width_m);
        let (answer, trace) = match locate_one_traced(localizer, path, &prior) {
            Ok((_, outcome, trace)) => (Answer::of(&frame.photo, &outcome), trace),
            Err(error) => {
                let answer = Answer::no_fix(&frame.photo, errors::message(&error));
                (answer, Trace::default())
            }
        };
        answers.push(answer);
        traces.push(trace);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok((answers, traces))
}

/// Scores answers against the image centre's true place (the receiver's, where no other is known), and beside it against the
/// receiver's.
pub fn score(name: &str, answers: &[Answer], truth: &[(TruthFrame, PathBuf)]) -> Run {
    score_with(name, answers, truth, None)
}

/// As [`score`], with the truth known to `truth_error_m` metres per axis (1 sigma) only.
fn score_with(
    name: &str,
    answers: &[Answer],
    truth: &[(TruthFrame, PathBuf)],
    truth_error_m: Option<f64>,
) -> Run {
    let frames: Vec<Frame> = answers
        .iter()
        .zip(truth)
        .map(|(answer, (frame, _))| {
            let place = frame.centre_lat_lon_deg.or(frame.gps_lat_lon_deg);
            let scored = match (answer.scored_fix(), place) {
                (Some(fix), Some((lat_deg, lon_deg))) => {
                    let mut scored = Frame::score(&frame.photo, &fix, LonLat { lon_deg, lat_deg });
                    if let Some(sigma_m) = truth_error_m {
                        scored = scored.with_truth_error(&fix, sigma_m);
                    }
                    if let Some((lat_deg, lon_deg)) = frame.gps_lat_lon_deg {
                        scored = scored.with_gps(&fix, LonLat { lon_deg, lat_deg });
                    }
                    scored
                }
                _ => Frame::missed(&frame.photo, answer.reason.as_deref().unwrap_or("no fix")),
            };
            Frame {
                confidence: answer.confidence,
                inliers: answer.inliers,
                time_ms: answer.time_ms.get("total").copied(),
                stage_ms: answer.time_ms.clone(),
                ..scored
            }
        })
        .collect();
    let summary = Summary::of(&frames);
    Run {
        name: name.to_owned(),
        frames,
        summary,
    }
}
