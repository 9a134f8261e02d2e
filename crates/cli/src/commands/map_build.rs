//! `grim map build`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{ArgGroup, Args};
use grimnet_geo::{Raster, concerns_of_place, is_tiff_name};
use grimnet_locate::Options;
use grimnet_net::Model;
use grimnet_output::{AtomicFile, TargetKind, linked_path};
use grimnet_pack::{
    BuildOptions, BuildReport, Levels, PackError, Phase, Progress, TILE_PX, build, working_files,
};
use grimnet_photo::{HeadingPrior, Photo, PhotoLimits, QUERY_LONG_SIDE_PX, ViewPrior};

use super::map_place::MapPlace;
use super::{LimitsChoice, ModeChoice, ModelChoice};
use crate::exit::Exit;
use crate::outputs::{OWN_MAGICS, OverwriteChoice};
use crate::standard_output::StandardOutput;
use crate::{inputs, interrupt, progress, values};
use grimnet_answer::printable;

/// Examples under the help of `grim map build`.
pub const EXAMPLES: &str = "\
Examples:
  grim map build town.tif -o town.grim
  grim map build town.tif -o town.grim --photo flight/DJI_0042.jpg    # only for photos like this one
  grim map build scan.png --corners 13.40,52.50,13.42,52.52 -o town.grim";

/// Heading of the options that choose ground resolutions.
const LEVELS: &str = "Ground resolutions [default: all that photos may need]";

/// Arguments of `grim map build`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("view").args(["height_agl", "photo"]))]
pub struct BuildArgs {
    /// The map
    #[arg(value_name = "MAP")]
    map: PathBuf,

    /// The pack to write
    ///
    /// While it is built, AREA.grim.partial holds the work so far. A device or pipe gets the finished
    /// pack, which is built in the temporary folder (TMPDIR) and not continued.
    #[arg(short, long, value_name = "AREA.grim", value_parser = values::output_file())]
    out: PathBuf,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    #[command(flatten)]
    place: MapPlace,

    #[command(flatten)]
    model: ModelChoice,

    /// Which method to use
    #[arg(long, value_enum, default_value_t)]
    mode: ModeChoice,

    /// Only for photos like this one: the ground resolution comes from its metadata
    #[arg(long, value_name = "SAMPLE.jpg", conflicts_with = "gsd", help_heading = LEVELS)]
    photo: Option<PathBuf>,

    /// Only for photos from this height (with --hfov), metres above ground
    #[arg(
        long,
        value_name = "M",
        value_parser = values::height_agl_m,
        allow_hyphen_values = true,
        requires = "hfov",
        conflicts_with_all = ["gsd", "photo"],
        help_heading = LEVELS
    )]
    height_agl: Option<f64>,

    /// Horizontal field of view, degrees (with --height-agl or --photo)
    #[arg(
        long,
        value_name = "DEG",
        value_parser = values::fov_deg,
        allow_hyphen_values = true,
        requires = "view",
        help_heading = LEVELS
    )]
    hfov: Option<f64>,

    /// Only these ground resolutions, metres per pixel
    #[arg(
        long,
        value_name = "M",
        value_parser = values::gsd_m,
        allow_hyphen_values = true,
        value_delimiter = ',',
        help_heading = LEVELS
    )]
    gsd: Option<Vec<f64>>,

    /// Recompute batch-normalisation statistics from this map
    #[arg(long)]
    adapt: bool,

    /// Side in pixels that a tile is resized to in paper mode [default: 320]
    #[arg(long, value_name = "PX")]
    resolution: Option<u32>,

    #[command(flatten)]
    limits: LimitsChoice,
}

/// Runs the command.
///
/// # Errors
/// Unreadable map, model or photo; a pack that cannot be written.
pub fn run(arguments: &BuildArgs) -> Result<Exit> {
    let out = &arguments.out;
    let policy = arguments
        .overwrite
        .policy()
        .protect(&arguments.map)
        .protect_all(&arguments.model.model)
        .protect_all(&arguments.photo);
    policy.check_file(out, OWN_MAGICS)?;
    let [partial, assembling] = working_files(&linked_path(out)?);
    for working_file in [&partial, &assembling] {
        policy.check_not_input(working_file)?;
    }
    let named = arguments.mode.build_options();
    if arguments.mode == ModeChoice::Default && arguments.resolution.is_some() {
        bail!("--resolution is of paper mode: give --mode paper as well, or leave it out");
    }
    if arguments.photo.is_none() && arguments.limits.photo() != PhotoLimits::DEFAULT {
        bail!("--max-photo-memory limits the photo of --photo: give that as well, or leave it out");
    }
    warn_if_among_maps(out, &arguments.map);
    let options = BuildOptions {
        levels: levels(arguments)?,
        adapt: arguments.adapt,
        resolution: arguments.resolution.unwrap_or(named.resolution),
        ..named
    };
    let model = arguments.model.open()?;
    let map = arguments.place.open(&arguments.map, &policy)?;
    warn_of_place(map.as_ref(), &arguments.map);
    policy.check_file(out, OWN_MAGICS)?;
    if TargetKind::of(out)? == TargetKind::Stream {
        let report = build_into_stream(map.as_ref(), &model, &options, out)?;
        // Standard output may be where the pack went.
        print_report(&mut std::io::stderr(), &report, out)?;
    } else {
        interrupt::end_on_interrupt(move || {
            tracing::warn!(
                "stopped; {} holds the work so far, and the same command goes on with it",
                partial.display()
            );
        })?;
        let report = build_with_bar(map.as_ref(), &model, &options, out)?;
        print_report(&mut StandardOutput, &report, out)?;
    }
    Ok(Exit::Done)
}

/// Warns of a pack that the next build would take for one of the maps in the folder.
fn warn_if_among_maps(out: &Path, map: &Path) {
    let folder = || {
        let out = std::path::absolute(linked_path(out).ok()?).ok()?;
        out.parent()?.canonicalize().ok()
    };
    if is_tiff_name(out.as_os_str()) && map.is_dir() && folder() == map.canonicalize().ok() {
        tracing::warn!(
            "{}: the pack has the name of a map and lies in the folder of the maps: that folder cannot be read as a map \
             afterwards; give the pack a name that ends in .grim",
            out.display()
        );
    }
}

/// Warns of a georeference that looks wrong: photos may get no fix on such a map, or fixes in the wrong place.
fn warn_of_place(map: &dyn Raster, path: &Path) {
    // A map whose centre has no position is refused by the build.
    for concern in concerns_of_place(map).into_iter().flatten() {
        tracing::warn!("{}: {concern}", path.display());
    }
}

fn print_report(to: &mut dyn Write, report: &BuildReport, out: &Path) -> Result<()> {
    let path = out.display().to_string();
    let path = printable(&path);
    if report.was_complete {
        writeln!(to, "{path}: already built from this map, model and options")?;
    } else {
        writeln!(
            to,
            "{path}: {} tiles, {:.1} MB; {} skipped (no data or black), {} taken from an interrupted run",
            report.tiles,
            report.len_bytes as f64 / 1e6,
            report.tiles_skipped,
            report.tiles_resumed
        )?;
    }
    Ok(())
}

/// Builds a pack under a progress bar.
///
/// # Errors
/// As [`build()`].
pub fn build_with_bar(
    map: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    out: &Path,
) -> Result<BuildReport> {
    let [partial, _] = working_files(&linked_path(out)?);
    let had_partial = partial.symlink_metadata().is_ok();
    let bar = progress::bar(0, "building the pack", "tiles");
    let mut done = 0;
    let mut resumed = 0;
    let mut on_progress = |p: &Progress| {
        done = p.tiles_done;
        if p.tiles_resumed > resumed {
            resumed = p.tiles_resumed;
            progress::go_on_from(&bar, p.tiles_done, p.tiles_total);
        }
        bar.set_length(p.tiles_total);
        bar.set_position(p.tiles_done);
        if p.phase == Phase::Writing {
            // All tiles are done, and writing a large pack takes its time.
            bar.set_message("(writing the pack)");
        }
    };
    let report = build(map, model, options, out, &mut on_progress);
    bar.finish_and_clear();
    if let Err(error) = &report
        && !matches!(error, PackError::Busy { .. })
        && done == 0
        && !had_partial
    {
        // Nothing was computed, as with a map that cannot be read: there is nothing to continue.
        let _ = fs_err::remove_file(&partial);
    }
    Ok(report?)
}

/// Builds a pack in a temporary folder and writes it through to a device or pipe.
fn build_into_stream(
    map: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    out: &Path,
) -> Result<BuildReport> {
    let folder = tempfile::tempdir()
        .context("a pack for a device or pipe is built in the temporary folder (TMPDIR)")?;
    let pack = folder.path().join("area.grim");
    let mut built = build_with_bar(map, model, options, &pack);
    if let Err(error) = &mut built
        && let Some(PackError::Io { hint, .. }) = error.downcast_mut()
    {
        // The work so far goes with the folder: the advice to go on with it is not for this.
        *hint = "; a pack for a device or pipe is built in the temporary folder (TMPDIR), which needs space for it, and is not continued";
    }
    let report = built?;
    let mut stream = AtomicFile::create(out)?;
    std::io::copy(&mut fs_err::File::open(&pack)?, &mut stream)?;
    stream.commit()?;
    Ok(report)
}

/// Which ground resolutions the arguments ask for.
fn levels(arguments: &BuildArgs) -> Result<Levels> {
    if let Some(gsd) = &arguments.gsd {
        return Ok(Levels::Gsd(gsd.clone()));
    }
    let footprint_m = if let (Some(height), Some(hfov)) = (arguments.height_agl, arguments.hfov) {
        2.0 * height * (hfov.to_radians() / 2.0).tan()
    } else if let Some(path) = &arguments.photo {
        inputs::check_regular(path)?;
        let photo = Photo::open_with(path, Some(QUERY_LONG_SIDE_PX), &arguments.limits.photo())?;
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
        footprint_m / photo_width_px(arguments.mode),
    ]))
}

/// Width of a photo in pixels of the level that is built for it.
fn photo_width_px(mode: ModeChoice) -> f64 {
    match mode {
        ModeChoice::Default => Options::default().query_width_px,
        // The whole photo and a whole tile are resized to the same square: a tile is as wide as the photo.
        ModeChoice::Paper => f64::from(TILE_PX),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        build: BuildArgs,
    }

    #[test]
    fn a_tile_of_paper_mode_is_as_wide_as_the_photo() {
        // 100 m above ground, 90 degrees: 200 m wide.
        let gsd_m = |mode: &str| {
            let words = "build map.tif -o area.grim --height-agl 100 --hfov 90 --mode";
            let words = words.split(' ').chain([mode]);
            match levels(&Program::parse_from(words).build).unwrap() {
                Levels::Gsd(list) => list[0],
                Levels::Auto => panic!("{mode}: all levels"),
            }
        };
        assert!((gsd_m("paper") * f64::from(TILE_PX) - 200.0).abs() < 1e-9);
        assert!((gsd_m("default") * Options::default().query_width_px - 200.0).abs() < 1e-9);
    }
}
