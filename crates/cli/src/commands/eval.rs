//! `grim eval`: measure accuracy on photos whose place is known.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use grimnet_eval::metrics::{Frame, Summary};
use grimnet_eval::report::{Report, Run};
use grimnet_eval::truth::{self, TruthFrame};
use grimnet_geo::{LonLat, open_map};
use grimnet_locate::{DEFAULT_MAP_ERROR_M, Localizer, Prior, Trace};
use grimnet_pack::{BuildOptions, Pack};

use super::experiment::{self, ExperimentOptions};
use super::gallery::{GalleryOptions, RunRecall, print_recall};
use super::locate::{AdaptChoice, LocateOptions, adapt_to_flight, locate_one_traced};
use super::map::{MapPlace, build_with_bar};
use super::{ModeChoice, ModelChoice};
use crate::answer::Answer;
use crate::exit::Exit;
use crate::progress;

/// The true heading is given to the localiser with this uncertainty, degrees (1 sigma).
const TRUE_HEADING_SIGMA_DEG: f64 = 5.0;

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
    /// A folder with map.tif, photos/ and truth.csv
    ///
    /// truth.csv has the columns photo, lat_deg, lon_deg (of the image centre; or centre_lat, centre_lon), and, where known,
    /// heading_deg, gps_lat, gps_lon.
    folder: Option<PathBuf>,

    /// Where summary.json, report.html, frames.csv and failed.jsonl are written
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,

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

    /// Width of ground that the photos show, metres, where it is known better than their metadata say
    #[arg(long, value_name = "M")]
    footprint_width: Option<f64>,

    /// Which recipe to follow
    #[arg(long, value_enum, default_value_t)]
    mode: ModeChoice,

    /// How far the map itself may lie beside the truth, metres (1 sigma per axis); the stated radius includes it
    #[arg(long, value_name = "M", default_value_t = DEFAULT_MAP_ERROR_M)]
    map_error: f64,

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
    if arguments.experiment.is_asked() {
        return experiment::run(
            &arguments.experiment,
            arguments.folder.as_deref(),
            arguments.footprint_width,
            arguments.mode,
            &arguments.model.open()?,
            &arguments.out,
        );
    }
    let folder = experiment::needed(arguments.folder.as_ref())?;
    let map_path = arguments
        .map
        .clone()
        .unwrap_or_else(|| folder.join("map.tif"));
    let truth = scorable(
        truth::read(&folder.join("truth.csv"))?,
        &folder.join("photos"),
    )?;
    let map = arguments
        .gallery
        .lay_out(open_map(&map_path, &arguments.place.options())?)?;
    let model = arguments.model.open()?;
    fs_err::create_dir_all(&arguments.out)?;
    let pack_path = arguments.out.join("area.grim");
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
    let mut localizer =
        Localizer::new(model, Pack::open(&pack_path)?)?.with_options(options.options());
    let paths: Vec<PathBuf> = truth.iter().map(|t| t.1.clone()).collect();
    if arguments.adapt == AdaptChoice::Flight {
        localizer = adapt_to_flight(localizer, &paths, &Prior::none())?;
    }
    let (mut runs, mut recalls) = (Vec::new(), Vec::new());
    for mode in arguments.heading_mode.runs() {
        let (answers, traces) = locate_all(&localizer, &truth, *mode, arguments.footprint_width)?;
        runs.push(score(mode.name(), &answers, &truth));
        let tried = traces.iter().zip(truth.iter().map(|t| &t.0));
        let radius_px = arguments.gallery.recall_radius;
        recalls.push(RunRecall::of(
            mode.name(),
            localizer.pack(),
            tried,
            radius_px,
        ));
    }
    write_results(&arguments.out, folder, &runs)?;
    let recall_json = serde_json::to_string_pretty(&recalls)?;
    fs_err::write(arguments.out.join("recall.json"), recall_json + "\n")?;
    print_summary(&runs)?;
    print_recall(&recalls)?;
    Ok(Exit::Done)
}

/// The truths that can be scored: photo there, place known. The others are named on standard error.
fn scorable(truth: Vec<TruthFrame>, photos: &Path) -> Result<Vec<(TruthFrame, PathBuf)>> {
    let mut usable = Vec::new();
    for frame in truth {
        let path = photos.join(&frame.photo);
        if !path.is_file() {
            tracing::warn!(
                "{}: named in truth.csv and not there; left out",
                path.display()
            );
        } else if frame.centre_lat_lon_deg.is_none() && frame.gps_lat_lon_deg.is_none() {
            tracing::warn!(
                "{}: truth.csv does not say where it is; left out",
                frame.photo
            );
        } else {
            usable.push((frame, path));
        }
    }
    if usable.is_empty() {
        bail!(
            "{}: no photo there whose place truth.csv tells",
            photos.display()
        );
    }
    Ok(usable)
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
        let prior = match (mode, frame.heading_deg) {
            (HeadingMode::Unknown, _) => Prior::none().with_unknown_heading(),
            (HeadingMode::Known, Some(heading)) => {
                Prior::none().with_heading(heading, TRUE_HEADING_SIGMA_DEG)
            }
            _ => Prior::none(),
        };
        let prior = match footprint_width_m {
            Some(width_m) => prior
                .with_gsd_m(width_m / f64::from(image::image_dimensions(path).map_or(1, |d| d.0))),
            None => prior,
        };
        let (answer, trace) = match locate_one_traced(localizer, path, &prior) {
            Ok((_, outcome, trace)) => (Answer::of(&frame.photo, &outcome), trace),
            Err(error) => {
                let answer = Answer::no_fix(&frame.photo, format!("{error:#}"));
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

/// Scores answers against the image centre's true place (the receiver's, where no other is known).
pub fn score(name: &str, answers: &[Answer], truth: &[(TruthFrame, PathBuf)]) -> Run {
    let frames: Vec<Frame> = answers
        .iter()
        .zip(truth)
        .map(|(answer, (frame, _))| {
            let place = frame.centre_lat_lon_deg.or(frame.gps_lat_lon_deg);
            let scored = match (answer.scored_fix(), place) {
                (Some(fix), Some((lat_deg, lon_deg))) => {
                    Frame::score(&frame.photo, &fix, LonLat { lon_deg, lat_deg })
                }
                _ => Frame::missed(&frame.photo, answer.reason.as_deref().unwrap_or("no fix")),
            };
            Frame {
                time_ms: answer.time_ms.get("total").copied(),
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

fn write_results(out: &Path, folder: &Path, runs: &[Run]) -> Result<()> {
    write_summary(&out.join("summary.json"), runs)?;
    let mut frames = csv::Writer::from_path(out.join("frames.csv"))?;
    frames.write_record([
        "run",
        "photo",
        "state",
        "error_m",
        "error_east_m",
        "error_north_m",
        "radius95_m",
        "reason",
        "time_ms",
    ])?;
    let mut failed = String::new();
    for run in runs {
        for frame in &run.frames {
            let number = |v: Option<f64>| v.map(|v| format!("{v:.3}")).unwrap_or_default();
            frames.write_record([
                run.name.clone(),
                frame.photo.clone(),
                if frame.fixed { "fix" } else { "no_fix" }.to_owned(),
                number(frame.error_m),
                number(frame.error_east_m),
                number(frame.error_north_m),
                number(frame.radius95_m),
                frame.reason.clone().unwrap_or_default(),
                number(frame.time_ms),
            ])?;
            if !frame.fixed {
                let line = serde_json::json!({ "run": run.name, "photo": frame.photo, "reason": frame.reason });
                failed.push_str(&format!("{line}\n"));
            }
        }
    }
    frames.flush()?;
    fs_err::write(out.join("failed.jsonl"), failed)?;
    let report = Report {
        title: format!("Accuracy on {}", folder.display()),
        description: vec![],
        runs: runs.to_vec(),
        pictures: vec![],
    };
    fs_err::write(out.join("report.html"), report.to_html()?)?;
    Ok(())
}

/// Writes the figures of each run under its name with underscores, such as `heading_known`.
///
/// # Errors
/// The file cannot be written.
pub fn write_summary(path: &Path, runs: &[Run]) -> Result<()> {
    let mut summary = serde_json::Map::new();
    for run in runs {
        summary.insert(
            run.name.replace(' ', "_"),
            serde_json::to_value(&run.summary)?,
        );
    }
    let text = serde_json::to_string_pretty(&summary)?;
    fs_err::write(path, text + "\n").context("cannot write the summary")?;
    Ok(())
}

/// Prints the figures, a column a run.
///
/// # Errors
/// Standard output is gone.
pub fn print_summary(runs: &[Run]) -> Result<()> {
    type Cell = fn(&Run) -> String;
    fn percent(share: f64) -> String {
        format!("{:.0} %", share * 100.0)
    }
    fn metres(value: Option<f64>) -> String {
        value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"))
    }
    let rows: [(&str, Cell); 10] = [
        ("", |r| r.name.clone()),
        ("frames", |r| r.summary.frames.to_string()),
        ("with a fix", |r| r.summary.fixes.to_string()),
        ("within 5 m", |r| percent(r.summary.within_5m)),
        ("within 10 m", |r| percent(r.summary.within_10m)),
        ("within 20 m", |r| percent(r.summary.within_20m)),
        ("median (a miss is infinite)", |r| {
            metres(r.summary.median_m)
        }),
        ("average of the fixes (ALE)", |r| metres(r.summary.ale_m)),
        ("confidently wrong", |r| {
            r.summary.confidently_wrong.to_string()
        }),
        ("median time a photo", |r| {
            r.summary
                .time_p50_ms
                .map_or_else(|| "-".to_owned(), |t| format!("{t:.0} ms"))
        }),
    ];
    let mut out = std::io::stdout().lock();
    for (name, cell) in rows {
        write!(out, "{name:<28}")?;
        for run in runs {
            write!(out, "{:>20}", cell(run))?;
        }
        writeln!(out)?;
    }
    Ok(())
}
