//! `grim map check`: what a map is, and what a pack of it would take, before it is built.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use clap::Args;
use grimnet_answer::printable_text;
use grimnet_eval::report::counted;
use grimnet_geo::{Concern, Raster, RasterPatch, concerns, overview};
use grimnet_limits::Limits;
use grimnet_net::Model;
use grimnet_pack::{BuildEstimate, BuildOptions, Levels, PackError, build, estimate};
use grimnet_program::exit::Exit;
use grimnet_program::map_place::MapPlace;
use grimnet_program::model_choice::ModelChoice;
use grimnet_program::outputs::OverwriteChoice;
use grimnet_program::terminal::has_colours;
use grimnet_program::values;
use serde::Serialize;

use super::map_picture::{picture_format, terminal_picture, write_picture};
use super::map_sample::MapSample;
use crate::standard_output::StandardOutput;

/// Examples under the help.
pub const EXAMPLES: &str = "\
Examples:
  grim map check town.mbtiles
  grim map check town.tif --draw town.png
  grim map check tiles/ --zoom 18 --json

Exit status: 0 nothing looks wrong, 1 something does, 2 the map cannot be read.";

/// Side of the part of the map whose features are computed to measure the time, level pixels: one block of the builder.
const SAMPLE_LEVEL_PX: f64 = 1024.0;
/// Cells in it.
const SAMPLE_CELLS: f64 = 16.0;

/// Arguments of `grim map check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The map
    #[arg(value_name = "MAP")]
    map: PathBuf,

    /// Print JSON
    #[arg(long)]
    json: bool,

    /// Write a small picture of the map
    #[arg(long, value_name = "PICTURE.png", value_parser = values::output_file())]
    draw: Option<PathBuf>,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    #[command(flatten)]
    place: MapPlace,

    #[command(flatten)]
    model: ModelChoice,
}

/// What is found, as JSON. Scripts rely on the names.
#[derive(Debug, Serialize)]
struct Report {
    map: String,
    description: String,
    crs: String,
    size_px: [u64; 2],
    ground_resolution_m: [f64; 2],
    /// West, south, east, north, degrees; `null` if the corners have no position on Earth. East is above 180 on a map
    /// that crosses the antimeridian.
    bounds_deg: Option<[f64; 4]>,
    levels: Vec<LevelReport>,
    tiles: Option<u64>,
    /// Size of the pack if all of the map has data.
    pack_bytes: Option<u64>,
    /// Time to build the pack on this machine, from a short run in the middle of the map.
    build_s: Option<f64>,
    concerns: Vec<ConcernReport>,
}

#[derive(Debug, Serialize)]
struct LevelReport {
    gsd_m: f64,
    tiles: u64,
}

#[derive(Debug, Serialize)]
struct ConcernReport {
    name: &'static str,
    text: String,
}

impl From<&Concern> for ConcernReport {
    fn from(concern: &Concern) -> Self {
        Self {
            name: concern.name(),
            text: concern.to_string(),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// The map or the model cannot be read, the picture cannot be written.
pub fn run(arguments: &CheckArgs) -> Result<Exit> {
    let policy = arguments
        .overwrite
        .policy()
        .protect(&arguments.map)
        .protect_all(&arguments.model.model);
    if let Some(picture) = &arguments.draw {
        policy.check_file(picture, &[])?;
    }
    let map = arguments.place.open(&arguments.map, &policy)?;
    if let Some(picture) = &arguments.draw {
        policy.check_file(picture, &[])?;
    }
    let format = arguments.draw.as_deref().map(picture_format).transpose()?;
    let model = arguments.model.open()?;
    let picture = overview(map.as_ref())?;
    if let (Some(path), Some(format)) = (&arguments.draw, format) {
        write_picture(&picture.rgb, format, path, &policy)?;
    }
    let report = report(arguments, map.as_ref(), &model, &picture)?;
    let mut out = StandardOutput;
    if arguments.json {
        serde_json::to_writer_pretty(&mut out, &report)?;
        writeln!(out)?;
    } else {
        if has_colours(&std::io::stdout()) {
            write!(out, "{}", terminal_picture(&picture))?;
        }
        print(&mut out, &report)?;
    }
    Ok(if report.concerns.is_empty() {
        Exit::Done
    } else {
        Exit::Incomplete
    })
}

fn report(
    arguments: &CheckArgs,
    map: &dyn Raster,
    model: &Model,
    picture: &RasterPatch,
) -> Result<Report> {
    let georeference = map.georeference();
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let (width, height) = map.size_px();
    let mut found: Vec<ConcernReport> = concerns(map, picture)?.iter().map(Into::into).collect();
    let plan = match estimate(
        map,
        model,
        &BuildOptions::standard(),
        &Limits::default().build,
    ) {
        Ok(plan) => Some(plan),
        Err(
            error @ (PackError::TooCostly { .. } | PackError::Scale { .. } | PackError::Options(_)),
        ) => {
            found.push(ConcernReport {
                name: "cannot_build",
                text: format!("no pack can be built: {error}"),
            });
            None
        }
        Err(error) => return Err(error.into()),
    };
    let build_s = plan
        .as_ref()
        .and_then(|plan| build_time_s(map, model, plan));
    Ok(Report {
        map: arguments.map.display().to_string(),
        description: map.describe(),
        crs: georeference.crs().to_string(),
        size_px: [width, height],
        ground_resolution_m: [x_m, y_m],
        bounds_deg: map.georeference().bounds_deg().ok(),
        tiles: plan.as_ref().map(BuildEstimate::tiles),
        pack_bytes: plan.as_ref().map(|plan| plan.pack_bytes),
        levels: plan
            .iter()
            .flat_map(|plan| &plan.levels)
            .map(|level| LevelReport {
                gsd_m: level.gsd_m,
                tiles: level.tiles,
            })
            .collect(),
        build_s,
        concerns: found,
    })
}

/// Time to build a pack on this machine, seconds, from one block in the middle of the map; `None` if there are no data.
fn build_time_s(map: &dyn Raster, model: &Model, plan: &BuildEstimate) -> Option<f64> {
    let finest = plan.levels.first()?;
    let sample = MapSample::in_the_middle(map, finest.gsd_m * SAMPLE_LEVEL_PX)?;
    let folder = tempfile::tempdir().ok()?;
    let options = BuildOptions {
        levels: Levels::Gsd(vec![finest.gsd_m]),
        ..BuildOptions::standard()
    };
    let start = Instant::now();
    build(
        &sample,
        model,
        &options,
        &folder.path().join("sample.grim"),
        &mut |_| {},
    )
    .ok()?;
    let seconds = start.elapsed().as_secs_f64();
    Some(seconds / (SAMPLE_CELLS * sample.share()) * plan.tiles() as f64)
}

fn print(out: &mut dyn Write, report: &Report) -> Result<()> {
    writeln!(out, "{}", printable_text(&report.description))?;
    if let Some([west, south, east, north]) = report.bounds_deg {
        writeln!(
            out,
            "extent   {west:.6} to {east:.6} east, {south:.6} to {north:.6} north; {:.2} x {:.2} km",
            report.size_px[0] as f64 * report.ground_resolution_m[0] / 1e3,
            report.size_px[1] as f64 * report.ground_resolution_m[1] / 1e3
        )?;
    }
    for level in &report.levels {
        writeln!(
            out,
            "level    {:.3} m per pixel: {}",
            level.gsd_m,
            counted(level.tiles as usize, "tile")
        )?;
    }
    if let (Some(tiles), Some(bytes)) = (report.tiles, report.pack_bytes) {
        let time = report.build_s.map_or_else(String::new, |seconds| {
            format!(", about {} on this machine", duration(seconds))
        });
        writeln!(
            out,
            "pack     {}, about {:.1} MB{time}",
            counted(tiles as usize, "tile"),
            bytes as f64 / 1e6
        )?;
    }
    if report.concerns.is_empty() {
        writeln!(out, "nothing looks wrong")?;
    }
    for concern in &report.concerns {
        writeln!(out, "warning  {}", printable_text(&concern.text))?;
    }
    Ok(())
}

/// `40 s`, `12 min`, `3.5 h`.
fn duration(seconds: f64) -> String {
    if seconds < 90.0 {
        format!("{seconds:.0} s")
    } else if seconds < 5400.0 {
        format!("{:.0} min", seconds / 60.0)
    } else {
        format!("{:.1} h", seconds / 3600.0)
    }
}
