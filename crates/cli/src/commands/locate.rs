//! `grim locate`: where photos were taken.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;
use clap::Args;
use grimnet_geo::{LonLat, distance_m};
use grimnet_locate::{Localizer, Options};
use grimnet_output::{OutputPolicy, PlannedOutput, check_apart};
use grimnet_pack::Pack;
use grimnet_photo::Photo;

pub use super::locate_options::{AdaptChoice, LocateOptions};
use super::map_place::MapPlace;
use super::{LimitsChoice, ModelChoice};
use crate::drawings::Drawings;
use crate::exit::Exit;
use crate::formats::{AnswerOutput, Format, TextTarget, stopped, warn_of_ending};
pub use crate::localise::{adapt_to_flight, locate_one};
use crate::localise::{open_pack, warn_if_off_the_map};
use crate::outputs::OverwriteChoice;
use crate::{errors, interrupt, photos, progress, values};
use grimnet_answer::{Answer, printable, rounded};

/// Examples under the help of `grim locate`.
pub const EXAMPLES: &str = "\
Examples:
  grim locate --pack town.grim flight/*.jpg
  grim locate --pack town.grim flight/ -o fixes.geojson
  grim locate --pack town.grim flight/ -o fixes.gpkg         # a GeoPackage for QGIS
  grim locate --pack town.grim a.jpg --heading unknown --height-agl 120 --hfov 73
  grim locate --pack town.grim flight/ --draw drawings --map town.tif

Exit status: 0 every photo has a fix, 1 some photos have no fix, 2 wrong use or a photo that cannot be read (the other \
photos are still answered), 130 stopped by Ctrl-C (the answers so far are written).";

/// Arguments of `grim locate`.
#[derive(Debug, Args)]
pub struct LocateArgs {
    /// The map pack (made by `grim map build`)
    #[arg(short, long, value_name = "AREA.grim")]
    pack: PathBuf,

    /// Photos (JPEG, PNG, WebP or TIFF), folders of photos, or patterns such as 'flight/*.jpg'
    #[arg(required = true)]
    photos: Vec<PathBuf>,

    #[command(flatten)]
    locate: LocateOptions,

    #[command(flatten)]
    model: ModelChoice,

    #[command(flatten)]
    limits: LimitsChoice,

    /// How to write the answers [default: by the ending of FILE; otherwise table on a terminal, jsonl in a pipe or file]
    #[arg(long, value_enum, help_heading = OUTPUT)]
    format: Option<Format>,

    /// Write the answers to this file; `-` is standard output [default: standard output]
    ///
    /// During the run the answers are in FILE.partial, which is well-formed after every photo and stays there if the run is
    /// killed; those of a GeoPackage are in memory. Ctrl-C ends the run after the current photo and completes FILE with the
    /// answers so far.
    #[arg(short, long, value_name = "FILE", help_heading = OUTPUT)]
    out: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    /// Also print the distance of each answer from the position in the photo's metadata
    #[arg(long, help_heading = OUTPUT)]
    check: bool,

    /// Draw the matches of each photo, and its outline on the map (with --map), into this folder, which may not be that of the photos
    #[arg(long, value_name = "DIR", value_parser = values::output_folder(), help_heading = OUTPUT)]
    draw: Option<PathBuf>,

    /// The map that the pack was built from, for --draw
    #[arg(long, value_name = "MAP", requires = "draw", help_heading = OUTPUT)]
    map: Option<PathBuf>,

    #[command(flatten)]
    place: MapPlace,
}

/// Heading of the options about output.
const OUTPUT: &str = "Output";

/// Runs the command.
///
/// # Errors
/// Unreadable pack, model or map; answers that cannot be written. A photo that cannot be read is answered in its own line.
pub fn run(arguments: &LocateArgs) -> Result<Exit> {
    arguments.place.check_is_used(arguments.map.is_some())?;
    let paths = photos::expand(&arguments.photos)?;
    let policy = policy(arguments, &paths);
    let out = TextTarget::of(arguments.out.as_deref());
    let mut planned = vec![out.planned("--out")];
    if let Some(folder) = &arguments.draw {
        let names = Drawings::names(&paths);
        planned.push(PlannedOutput::folder("--draw", folder, names));
    }
    check_apart(&planned)?;
    out.check(&policy)?;
    let options = Options {
        keep_matches: arguments.draw.is_some(),
        ..arguments.locate.options()?
    };
    let pack = open_pack(&arguments.pack, options.mode)?;
    let mut drawings = drawings(arguments, &pack, &paths, &policy)?;
    let localizer = localizer(arguments, options, pack, &paths)?;
    if let Some(near) = &arguments.locate.near {
        warn_if_off_the_map("--near", near, &localizer)?;
    }

    let named = out.file().and_then(Format::of_name);
    if let Some(file) = out.file() {
        warn_of_ending(file, named, arguments.format);
    }
    let format = arguments.format.or(named).unwrap_or_else(|| {
        if out.is_terminal() {
            Format::Table
        } else {
            Format::Jsonl
        }
    });
    let mut stream = AnswerOutput::open(format, out, &policy)?;
    let partial = stream.partial_path();
    locate_all(
        arguments,
        &localizer,
        &paths,
        format,
        &mut stream,
        &mut drawings,
    )
    .and_then(|exit| stream.finish().map(|()| exit))
    .map_err(|error| stopped(error, "the answers so far are in", partial))
}

/// What may be replaced: no photo, pack, model or map of this run.
fn policy(arguments: &LocateArgs, photos: &[PathBuf]) -> OutputPolicy {
    arguments
        .overwrite
        .policy()
        .protect(&arguments.pack)
        .protect_all(photos)
        .protect_all(&arguments.model.model)
        .protect_all(&arguments.map)
}

fn drawings(
    arguments: &LocateArgs,
    pack: &Pack,
    photos: &[PathBuf],
    policy: &OutputPolicy,
) -> Result<Option<Drawings>> {
    let Some(folder) = &arguments.draw else {
        return Ok(None);
    };
    let open = |path: &PathBuf| arguments.place.open_of_pack(path, policy, pack);
    let map = arguments.map.as_ref().map(open).transpose()?;
    Drawings::open(folder, policy, photos, map).map(Some)
}

fn localizer(
    arguments: &LocateArgs,
    options: Options,
    pack: Pack,
    photos: &[PathBuf],
) -> Result<Localizer> {
    let localizer = Localizer::builder()
        .model(arguments.model.open()?)
        .options(options)
        .build(pack)?;
    if arguments.locate.adapt == AdaptChoice::Flight {
        let limits = arguments.limits.photo();
        return adapt_to_flight(localizer, photos, &arguments.locate.prior(), &limits);
    }
    Ok(localizer)
}

/// Answers photo by photo until the last one or Ctrl-C.
fn locate_all(
    arguments: &LocateArgs,
    localizer: &Localizer,
    paths: &[PathBuf],
    format: Format,
    stream: &mut AnswerOutput,
    drawings: &mut Option<Drawings>,
) -> Result<Exit> {
    let stop = Arc::new(AtomicBool::new(false));
    interrupt::stop_on_interrupt(&stop)?;
    let (prior, limits) = (arguments.locate.prior(), arguments.limits.photo());
    let bar = progress::bar(paths.len() as u64, "locating", "photos");
    let (mut unreadable, mut without_fix) = (0, 0);
    for (number, path) in paths.iter().enumerate() {
        if stop.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            tracing::warn!("interrupted after {number} of {} photos", paths.len());
            return Ok(Exit::Interrupted);
        }
        let answer = match locate_one(localizer, path, &prior, &limits) {
            Ok((photo, outcome)) => {
                if let Some(drawings) = drawings {
                    drawings.draw(number, &photo, &outcome);
                }
                let mut answer = Answer::of(&path.display().to_string(), &outcome);
                if arguments.check {
                    answer.check_m = check_m(&photo, &answer).map(|m| rounded(m, 3));
                }
                without_fix += usize::from(answer.reason.is_some());
                answer
            }
            Err(error) => {
                unreadable += 1;
                if let Some(drawings) = drawings {
                    drawings.leave_out(number);
                }
                let message = errors::message_with_hint(&error);
                if format == Format::Gpx {
                    // GPX has only photos with a fix: nothing else would say which photo it is.
                    bar.suspend(|| tracing::warn!("{}", printable(&message)));
                }
                Answer {
                    damaged: errors::is_damaged_photo(&error),
                    ..Answer::no_fix(&path.display().to_string(), message)
                }
            }
        };
        bar.suspend(|| stream.write(&answer))?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    if unreadable > 0 {
        tracing::warn!("{unreadable} of {} photos could not be read", paths.len());
    }
    if without_fix > 0 && arguments.out.is_some() {
        // Where the table is shown, it counts them.
        let lists = if format == Format::Gpx {
            "; GPX leaves them out, --format jsonl gives the reasons"
        } else {
            ""
        };
        tracing::warn!("{without_fix} of {} photos have no fix{lists}", paths.len());
    }
    let not_drawn = drawings.as_ref().map_or(0, |drawings| drawings.failed);
    Ok(if unreadable + not_drawn > 0 {
        Exit::Failed
    } else if without_fix > 0 {
        Exit::SomeWithoutFix
    } else {
        Exit::Done
    })
}

/// Distance in metres between the answer and the position in the photo's metadata.
fn check_m(photo: &Photo, answer: &Answer) -> Option<f64> {
    let gps = photo.metadata.position?;
    let (lat_deg, lon_deg) = answer.lat_deg.zip(answer.lon_deg)?;
    let recorded = LonLat {
        lon_deg: gps.lon_deg,
        lat_deg: gps.lat_deg,
    };
    Some(distance_m(recorded, LonLat { lon_deg, lat_deg }))
}
