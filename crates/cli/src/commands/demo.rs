//! `grim demo`: a procedural town, photos of a survey, every one located, and a flight that is followed. Nothing to download.

use std::io::Write;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use grimnet_eval::datasets::{DataSet, DataSetRequest};
use grimnet_eval::evaluation::Trial;
use grimnet_eval::report::results::summary_json;
use grimnet_eval::report::{Picture, Report, Run};
use grimnet_eval::scene::{HeadingMode, Scene};
use grimnet_geo::MapOptions;
use grimnet_locate::{Localizer, Options};
use grimnet_output::OutputFolder;
use grimnet_pack::{BuildOptions, Pack};
use grimnet_photo::PhotoLimits;
use grimnet_world::WorldConfig;

use super::ModelChoice;
use super::demo_flight::follow_crossing;
use super::eval_pictures::{COLOURS, matches_jpeg};
use super::eval_run::{answers, evaluate_all};
use super::map::build_with_bar;
use super::results::print_summary;
use super::serve;
use crate::exit::Exit;
use crate::formats::Format;
use crate::outputs::{OWN_MAGICS, OverwriteChoice};
use crate::procedural_flight::{MAP, MAP_GSD_M, make_flight};
use crate::standard_output::StandardOutput;
use crate::values;
use grimnet_answer::printable;

/// Match pictures that the report shows.
const PICTURES: usize = 6;

/// Files in the folder, beside the pack.
const FILES: [&str; 10] = [
    MAP,
    "truth.csv",
    "fixes.jsonl",
    "fixes_unknown_heading.jsonl",
    "summary.json",
    "report.html",
    "flight_truth.csv",
    "track.jsonl",
    "track.gpx",
    "track.html",
];

/// The pack in the folder.
const PACK: &str = "area.grim";

/// Examples under the help of `grim demo`.
pub const EXAMPLES: &str = "\
Examples:
  grim demo                           # about a minute; then open demo/report.html
  grim demo --seed 8 -o another       # another town, in the folder `another`
  grim demo --serve                   # then drop its photos on the page at http://127.0.0.1:8080";

/// Arguments of `grim demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Folder for map, photos, truth, pack, fixes and report
    ///
    /// A second demo replaces the files of the first one. Files that the demo did not write stay; if one is in the way, the
    /// demo refuses to start (see --overwrite).
    #[arg(short, long, value_name = "DIR", default_value = "demo", value_parser = values::output_folder())]
    out: PathBuf,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    /// Seed of the town: another number gives another town
    #[arg(long, value_name = "N", default_value_t = 7)]
    seed: u64,

    /// Number of photos of the flight
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = values::photo_count)]
    photos: usize,

    #[command(flatten)]
    model: ModelChoice,

    /// Then serve the map page on this address, as `grim serve` does [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8080", value_parser = values::socket_address)]
    serve: Option<SocketAddr>,
}

/// Runs the command.
///
/// # Errors
/// The folder cannot be written.
pub fn run(arguments: &DemoArgs) -> Result<Exit> {
    let started = Instant::now();
    let out = &arguments.out;
    let policy = arguments
        .overwrite
        .policy()
        .protect_all(&arguments.model.model);
    if let Some(address) = arguments.serve {
        // What cannot be served is refused at once, not after the work.
        serve::check_demo(address)?;
    }
    let folder = OutputFolder::open(out, &policy)?;
    let matches = folder.subfolder("matches")?;
    folder.check(FILES)?;
    policy.check_file(out.join(PACK), OWN_MAGICS)?;
    let model = arguments.model.open()?;
    make_flight(&folder, arguments.seed, arguments.photos)?;
    let data = DataSet::find(&DataSetRequest {
        folder: out,
        map: None,
        map_options: MapOptions::default(),
        scratch: out,
        photo_limits: PhotoLimits::DEFAULT,
    })?;
    let map = data.open_map()?;
    let scene = data.into_scene(map)?;
    let pack = out.join(PACK);
    build_with_bar(scene.map.as_ref(), &model, &BuildOptions::standard(), &pack)?;
    let localizer = Localizer::new(model, Pack::open(&pack)?)?.with_options(Options {
        keep_matches: true,
        // The map is drawn from the town itself.
        map_error_m: 0.0,
        ..Options::default()
    });

    let (mut runs, mut first_trials) = (Vec::new(), Vec::new());
    for (mode, name, file) in [
        (HeadingMode::FromPhoto, "heading known", "fixes.jsonl"),
        (
            HeadingMode::Unknown,
            "heading unknown",
            "fixes_unknown_heading.jsonl",
        ),
    ] {
        let (run, trials) = evaluate_all(&localizer, &scene.shots, mode, name);
        let text = Format::Jsonl.text_of(&answers(&trials))?;
        folder.write_bytes(file, text.as_bytes())?;
        runs.push(run);
        if first_trials.is_empty() {
            first_trials = trials;
        }
    }
    folder.write_bytes("summary.json", summary_json(None, &runs)?.as_bytes())?;
    let pictures = draw_some(&scene, &first_trials, &matches)?;
    let report = report(scene.shots.len(), runs.clone(), pictures);
    folder.write_bytes("report.html", report.to_html()?.as_bytes())?;

    let tracked = follow_crossing(&folder, arguments.seed, localizer, scene.map.as_ref())?;
    // When all is written: a reader that goes away (`| head`) ends the run.
    print_summary(&runs)?;
    writeln!(
        StandardOutput,
        "\n{tracked}\n\n{:.0} s in all. The report is {}, pictures of matches are in {}",
        started.elapsed().as_secs_f64(),
        printable(&out.join("report.html").display().to_string()),
        printable(&matches.path().display().to_string())
    )?;
    match arguments.serve {
        Some(address) => serve_flight(arguments, address),
        None => Ok(Exit::Done),
    }
}

/// The report, with what was made in words.
fn report(photos: usize, runs: Vec<Run>, pictures: Vec<Picture>) -> Report {
    Report {
        title: "A flight over a procedural town".into(),
        description: vec![
            format!(
                "{photos} photos from 100 to 130 m above ground, taken in another season, light and year than the map, with a tilted \
                 camera and metadata errors; {:.0} m of town and countryside at {MAP_GSD_M} m per pixel.",
                WorldConfig::default().size_m
            ),
            "Everything here was made by this program: there is no such town, and real maps are harder. The map has no error of its own, so \
             that the stated radii leave it out; grim locate and grim eval count 1 m per axis (--map-error)."
                .into(),
        ],
        runs,
        pictures,
    }
}

/// Serves the town, to drop the flight's photos on it.
fn serve_flight(arguments: &DemoArgs, address: SocketAddr) -> Result<Exit> {
    let out = &arguments.out;
    writeln!(
        StandardOutput,
        "Drop photos from {} on the page:",
        printable(&out.join("photos").display().to_string())
    )?;
    serve::run_on_demo(
        arguments.model.clone(),
        &out.join(PACK),
        &out.join(MAP),
        address,
    )
}

/// Draws the matches of a few photos, those with the largest errors first.
fn draw_some(scene: &Scene, trials: &[Trial], folder: &OutputFolder) -> Result<Vec<Picture>> {
    let mut worst: Vec<usize> = (0..trials.len())
        .filter(|i| trials[*i].frame.fixed)
        .collect();
    let error_m = |i: usize| trials[i].frame.error_m.unwrap_or(0.0);
    worst.sort_by(|a, b| error_m(*b).total_cmp(&error_m(*a)));
    // Two of the worst, the others from the whole range.
    let step = (worst.len() / PICTURES).max(1);
    let chosen = worst
        .iter()
        .take(2)
        .chain(worst.iter().skip(step.max(2)).step_by(step))
        .take(PICTURES);
    let mut pictures = Vec::new();
    for &i in chosen {
        let shot = &scene.shots[i];
        let Some(jpeg) = matches_jpeg(shot, &trials[i], scene.map.as_ref())? else {
            continue;
        };
        folder.write_bytes(&shot.name, &jpeg)?;
        pictures.push(Picture {
            caption: format!("{}: error {:.1} m ({COLOURS})", shot.name, error_m(i)),
            jpeg,
        });
    }
    folder.prune(|_| true)?;
    Ok(pictures)
}
