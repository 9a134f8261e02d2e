//! `grim demo`: a procedural town, a flight over it, every photo located. Nothing to download.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use grimnet_eval::report::{Picture, Report, Run};
use grimnet_eval::truth::{self, TruthFrame};
use grimnet_geo::{MapOptions, Raster, open_map};
use grimnet_locate::{Localizer, Options, Prior};
use grimnet_output::OutputFolder;
use grimnet_pack::{BuildOptions, Pack};
use grimnet_world::WorldConfig;

use super::ModelChoice;
use super::eval::{HeadingMode, locate_all, score};
use super::locate::locate_one;
use super::map::build_with_bar;
use super::results::{print_summary, write_summary};
use crate::drawings::jpeg_of;
use crate::exit::Exit;
use crate::formats::Format;
use crate::outputs::{OWN_MAGICS, OverwriteChoice};
use crate::procedural_flight::{MAP_GSD_M, make_flight};
use crate::terminal::printable;
use crate::values;

/// Match pictures that the report shows.
const PICTURES: usize = 6;

/// Files in the folder, beside the pack.
const FILES: [&str; 6] = [
    "map.tif",
    "truth.csv",
    "fixes.jsonl",
    "fixes_unknown_heading.jsonl",
    "summary.json",
    "report.html",
];

/// The pack in the folder.
const PACK: &str = "area.grim";

/// Examples under the help of `grim demo`.
pub const EXAMPLES: &str = "\
Examples:
  grim demo                           about a minute; then open demo/report.html
  grim demo --seed 8 -o another       another town, in the folder `another`";

/// Arguments of `grim demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Folder for map, photos, truth, pack, fixes and report
    ///
    /// A second demo replaces the files of the first one. Files that the demo did not write stay; if one is in the way, the
    /// demo refuses to start (see --overwrite).
    #[arg(short, long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    /// Seed of the town: another number gives another town
    #[arg(long, value_name = "N", default_value_t = 7)]
    seed: u64,

    /// Number of photos of the flight
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = values::count)]
    photos: usize,

    #[command(flatten)]
    model: ModelChoice,
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
    let folder = OutputFolder::open(out, &policy)?;
    let matches = folder.subfolder("matches")?;
    folder.check(FILES)?;
    policy.check_file(out.join(PACK), OWN_MAGICS)?;
    let model = arguments.model.open()?;
    make_flight(&folder, arguments.seed, arguments.photos)?;
    let truth: Vec<(TruthFrame, PathBuf)> = truth::read(&out.join("truth.csv"))?
        .into_iter()
        .map(|frame| {
            let path = out.join("photos").join(&frame.photo);
            (frame, path)
        })
        .collect();

    let map = open_map(&out.join("map.tif"), &MapOptions::default())?;
    let pack = out.join(PACK);
    build_with_bar(map.as_ref(), &model, &BuildOptions::standard(), &pack)?;
    let localizer = Localizer::new(model, Pack::open(&pack)?)?.with_options(Options {
        keep_matches: true,
        // The map is drawn from the town itself.
        map_error_m: 0.0,
        ..Options::default()
    });

    let mut runs = Vec::new();
    for (mode, file) in [
        (HeadingMode::Exif, "fixes.jsonl"),
        (HeadingMode::Unknown, "fixes_unknown_heading.jsonl"),
    ] {
        let (answers, _) = locate_all(&localizer, &truth, mode, None)?;
        folder.write_bytes(file, Format::Jsonl.text_of(&answers)?.as_bytes())?;
        let name = if mode == HeadingMode::Exif {
            "heading known"
        } else {
            mode.name()
        };
        runs.push(score(name, &answers, &truth));
    }
    write_summary(&folder, &runs)?;
    let pictures = draw_some(&localizer, map.as_ref(), &truth, &runs[0], &matches)?;
    let report = Report {
        title: "A flight over a procedural town".into(),
        description: vec![
            format!(
                "{} photos from 100 to 130 m above ground, taken in another season, light and year than the map, with a tilted \
                 camera and metadata errors; {:.0} m of town and countryside at {MAP_GSD_M} m per pixel.",
                truth.len(),
                WorldConfig::default().size_m
            ),
            "Everything here was made by this program: there is no such town, and real maps are harder.".into(),
        ],
        runs: runs.clone(),
        pictures,
    };
    folder.write_bytes("report.html", report.to_html()?.as_bytes())?;

    print_summary(&runs)?;
    writeln!(
        std::io::stdout(),
        "\n{:.0} s in all. The report is {}, pictures of matches are in {}",
        started.elapsed().as_secs_f64(),
        printable(&out.join("report.html").display().to_string()),
        printable(&matches.path().display().to_string())
    )?;
    Ok(Exit::Done)
}

/// Draws the matches of a few photos, those with the largest errors first.
fn draw_some(
    localizer: &Localizer,
    map: &dyn Raster,
    truth: &[(TruthFrame, PathBuf)],
    run: &Run,
    folder: &OutputFolder,
) -> Result<Vec<Picture>> {
    let mut worst: Vec<usize> = (0..truth.len()).filter(|i| run.frames[*i].fixed).collect();
    worst.sort_by(|a, b| {
        let error = |i: usize| run.frames[i].error_m.unwrap_or(0.0);
        error(*b).total_cmp(&error(*a))
    });
    // Two of the worst, the others from the whole range.
    let step = (worst.len() / PICTURES).max(1);
    let chosen = worst
        .iter()
        .take(2)
        .chain(worst.iter().skip(step).step_by(step))
        .take(PICTURES);
    let mut pictures = Vec::new();
    for &i in chosen {
        let (frame, path) = &truth[i];
        let (photo, outcome) = locate_one(localizer, path, &Prior::none())?;
        let Some(jpeg) = jpeg_of(&photo, &outcome, Some(map))? else {
            continue;
        };
        folder.write_bytes(&frame.photo, &jpeg)?;
        pictures.push(Picture {
            caption: format!(
                "{}: {:.1} m off",
                frame.photo,
                run.frames[i].error_m.unwrap_or(f64::NAN)
            ),
            jpeg,
        });
    }
    folder.prune(|_| true)?;
    Ok(pictures)
}
