//! `grim map`: build a pack, look into one.

use std::io::Write;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, Result, bail};
use clap::{Args, Subcommand};
use grimnet_geo::{MapOptions, open_map};
use grimnet_locate::Options;
use grimnet_pack::{BuildOptions, BuildReport, Levels, Pack, Progress, build};
use grimnet_photo::{HeadingPrior, Photo, ViewPrior};

use super::{ModeChoice, ModelChoice};
use crate::exit::Exit;
use crate::progress;

/// Build a map pack from your own map, or look into one.
#[derive(Debug, Subcommand)]
pub enum MapCommand {
    /// Compute, once, what the network sees of a map
    ///
    /// Reads GeoTIFF and COG in any projection, a picture with a world file (with --crs), a picture with --corners,
    /// or a CSV of corner-annotated pictures. An interrupted build goes on where it was when the same command is
    /// given again.
    Build(BuildArgs),
    /// What a pack holds
    Info(InfoArgs),
}

/// How the map's place is told where the file does not tell it.
#[derive(Debug, Clone, Args)]
pub struct MapPlace {
    /// Coordinate system of a map that does not state it, such as EPSG:25833
    #[arg(long, value_name = "CRS")]
    pub crs: Option<String>,

    /// Corners of a picture without georeference, degrees
    #[arg(
        long,
        value_name = "LL_LON,LL_LAT,UR_LON,UR_LAT",
        allow_hyphen_values = true
    )]
    pub corners: Option<CornersChoice>,
}

/// `LL_LON,LL_LAT,UR_LON,UR_LAT`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornersChoice([f64; 4]);

impl FromStr for CornersChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
        numbers
            .ok()
            .and_then(|n| n.try_into().ok())
            .map(Self)
            .ok_or_else(|| {
                "longitude and latitude of the lower left, then of the upper right corner, degrees, such as \
                 13.40,52.50,13.42,52.52"
                    .to_owned()
            })
    }
}

impl MapPlace {
    /// As the raster reader takes it.
    pub fn options(&self) -> MapOptions {
        MapOptions {
            crs: self.crs.clone(),
            corners: self.corners.map(|c| c.0),
            ..MapOptions::default()
        }
    }
}

/// Arguments of `grim map build`.
#[derive(Debug, Args)]
pub struct BuildArgs {
    /// The map
    map: PathBuf,

    /// The pack to write
    #[arg(short, long, value_name = "AREA.grim")]
    out: PathBuf,

    #[command(flatten)]
    place: MapPlace,

    #[command(flatten)]
    model: ModelChoice,

    /// Which recipe to follow
    #[arg(long, value_enum, default_value_t)]
    mode: ModeChoice,

    /// Only the ground resolution that this photo needs
    #[arg(long, value_name = "SAMPLE.jpg", conflicts_with = "gsd")]
    photo: Option<PathBuf>,

    /// Only the ground resolution needed from this height (with --hfov), metres above ground
    #[arg(long, value_name = "M", requires = "hfov", conflicts_with_all = ["gsd", "photo"])]
    height_agl: Option<f64>,

    /// Horizontal field of view, degrees
    #[arg(long, value_name = "DEG")]
    hfov: Option<f64>,

    /// Only these ground resolutions, metres per pixel
    #[arg(long, value_name = "M", value_delimiter = ',')]
    gsd: Option<Vec<f64>>,

    /// Take the normalisation statistics anew from this map
    #[arg(long)]
    adapt: bool,

    /// Side in pixels that a tile is resized to in paper mode
    #[arg(long, value_name = "PX", default_value_t = 320)]
    resolution: u32,
}

/// Arguments of `grim map info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The pack
    pack: PathBuf,

    /// As JSON
    #[arg(long)]
    json: bool,

    /// Draw the map with its tiles into this picture (needs --map)
    #[arg(long, value_name = "PICTURE.png", requires = "map")]
    draw: Option<PathBuf>,

    /// The map that the pack was built from
    #[arg(long, value_name = "MAP")]
    map: Option<PathBuf>,

    /// Level to draw, 0 the finest
    #[arg(long, value_name = "N", default_value_t = 0)]
    level: usize,

    #[command(flatten)]
    place: MapPlace,
}

/// Runs the command.
///
/// # Errors
/// Unreadable map, model or pack; a pack that cannot be written.
pub fn run(command: MapCommand) -> Result<Exit> {
    match command {
        MapCommand::Build(arguments) => run_build(&arguments),
        MapCommand::Info(arguments) => run_info(&arguments),
    }
}

fn run_build(arguments: &BuildArgs) -> Result<Exit> {
    let model = arguments.model.open()?;
    let map = open_map(&arguments.map, &arguments.place.options())?;
    let options = BuildOptions {
        levels: levels(arguments)?,
        adapt: arguments.adapt,
        resolution: arguments.resolution,
        ..match arguments.mode {
            ModeChoice::Default => BuildOptions::standard(),
            ModeChoice::Paper => BuildOptions::paper(),
        }
    };
    let report = build_with_bar(map.as_ref(), &model, &options, &arguments.out)?;
    let mut out = std::io::stdout().lock();
    if report.was_complete {
        writeln!(
            out,
            "{}: already built from this map, model and options",
            report.path.display()
        )?;
    } else {
        writeln!(
            out,
            "{}: {} tiles, {:.1} MB; {} skipped (no data or black), {} taken from an interrupted run",
            report.path.display(),
            report.tiles,
            report.len_bytes as f64 / 1e6,
            report.tiles_skipped,
            report.tiles_resumed
        )?;
    }
    Ok(Exit::Done)
}

/// Builds a pack under a progress bar.
///
/// # Errors
/// As [`build()`].
pub fn build_with_bar(
    map: &dyn grimnet_geo::Raster,
    model: &grimnet_net::Model,
    options: &BuildOptions,
    out: &std::path::Path,
) -> Result<BuildReport> {
    let bar = progress::bar(0, "building the pack", "tiles");
    let mut on_progress = |p: &Progress| {
        bar.set_length(p.tiles_total);
        bar.set_position(p.tiles_done);
    };
    let report = build(map, model, options, out, &mut on_progress)?;
    bar.finish_and_clear();
    Ok(report)
}

/// Which ground resolutions the arguments ask for.
fn levels(arguments: &BuildArgs) -> Result<Levels> {
    if let Some(gsd) = &arguments.gsd {
        if let Some(bad) = gsd.iter().find(|g| !g.is_finite() || **g <= 0.0) {
            bail!("--gsd {bad}: a ground resolution is a positive number of metres per pixel");
        }
        return Ok(Levels::Gsd(gsd.clone()));
    }
    let footprint_m = if let (Some(height), Some(hfov)) = (arguments.height_agl, arguments.hfov) {
        2.0 * height * (hfov.to_radians() / 2.0).tan()
    } else if let Some(path) = &arguments.photo {
        let photo = Photo::open(path)?;
        let overrides = ViewPrior {
            heading: HeadingPrior::Unknown,
            hfov_deg: arguments.hfov,
            ..ViewPrior::default()
        };
        photo
            .view(&overrides)
            .footprint
            .map(|footprint| footprint.width_m)
            .with_context(|| {
                format!(
                    "{}: its metadata does not tell how much ground it shows; give --height-agl with --hfov, or --gsd",
                    path.display()
                )
            })?
    } else {
        return Ok(Levels::Auto);
    };
    Ok(Levels::Gsd(vec![
        footprint_m / Options::default().query_width_px,
    ]))
}

fn run_info(arguments: &InfoArgs) -> Result<Exit> {
    let pack = Pack::open(&arguments.pack)?;
    let info = pack.info();
    let mut out = std::io::stdout().lock();
    if arguments.json {
        serde_json::to_writer_pretty(&mut out, &info)?;
        writeln!(out)?;
    } else {
        writeln!(out, "{info}")?;
    }
    if let (Some(picture), Some(map)) = (&arguments.draw, &arguments.map) {
        let map = open_map(map, &arguments.place.options())?;
        grimnet_pack::draw(&pack, arguments.level, map.as_ref())?
            .save(picture)
            .with_context(|| format!("cannot write {}", picture.display()))?;
    }
    Ok(Exit::Done)
}
