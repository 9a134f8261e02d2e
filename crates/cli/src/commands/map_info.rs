//! `grim map info` and `grim map verify`.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use grimnet_pack::Pack;

use super::map_picture::{picture_format, write_picture};
use super::map_place::{MapPlace, check_built_from};
use crate::exit::Exit;
use crate::outputs::OverwriteChoice;
use crate::standard_output::StandardOutput;
use crate::{inputs, progress, values};
use grimnet_answer::printable_text;

/// Examples under the help of `grim map info`.
pub const INFO_EXAMPLES: &str = "\
Example:
  grim map info town.grim
  grim map info town.grim --map town.tif --draw tiles.png";

/// Examples under the help of `grim map verify`.
pub const VERIFY_EXAMPLES: &str = "\
Example:
  grim map verify town.grim

Exit status: 0 the pack is whole, 2 it is damaged or cannot be read.";

/// Arguments of `grim map info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// The pack
    pack: PathBuf,

    /// Print JSON
    #[arg(long)]
    json: bool,

    /// Draw the map with its tiles into this picture (with --map)
    #[arg(long, value_name = "PICTURE.png", requires = "map", value_parser = values::output_file())]
    draw: Option<PathBuf>,

    /// The map that the pack was built from, for --draw
    #[arg(long, value_name = "MAP", requires = "draw")]
    map: Option<PathBuf>,

    /// Level to draw; 0 is the finest
    #[arg(long, value_name = "N", default_value_t = 0, requires = "draw")]
    level: usize,

    #[command(flatten)]
    overwrite: OverwriteChoice,

    #[command(flatten)]
    place: MapPlace,
}

/// Arguments of `grim map verify`.
#[derive(Debug, Args)]
pub struct VerifyArgs {
    /// The pack
    pack: PathBuf,
}

/// Prints what a pack holds, and draws its tiles if asked to.
///
/// # Errors
/// Unreadable pack or map, a picture that cannot be written.
pub fn info(arguments: &InfoArgs) -> Result<Exit> {
    arguments.place.check_is_used(arguments.map.is_some())?;
    inputs::check_regular(&arguments.pack)?;
    let pack = Pack::open(&arguments.pack)?;
    if let (Some(picture), Some(map)) = (&arguments.draw, &arguments.map) {
        let format = picture_format(picture)?;
        let policy = arguments
            .overwrite
            .policy()
            .protect(&arguments.pack)
            .protect(map);
        policy.check_file(picture, &[])?;
        let raster = arguments.place.open(map, &policy)?;
        policy.check_file(picture, &[])?;
        check_built_from(&pack, raster.as_ref(), map)?;
        let drawn = grimnet_pack::draw(&pack, arguments.level, raster.as_ref())?;
        write_picture(&drawn, format, picture, &policy)?;
    }
    let info = pack.info();
    let mut out = StandardOutput;
    if arguments.json {
        serde_json::to_writer_pretty(&mut out, &info)?;
        writeln!(out)?;
    } else {
        writeln!(out, "{}", printable_text(info.to_string().trim_end()))?;
    }
    Ok(Exit::Done)
}

/// Checks every byte of a pack.
///
/// # Errors
/// The pack is damaged or cannot be read.
pub fn verify(arguments: &VerifyArgs) -> Result<Exit> {
    inputs::check_regular(&arguments.pack)?;
    let pack = Pack::open(&arguments.pack)?;
    let bar = progress::bar(0, "verifying", "MB");
    pack.verify(&mut |progress| {
        bar.set_length(progress.total_bytes / 1_000_000);
        bar.set_position(progress.done_bytes / 1_000_000);
    })?;
    bar.finish_and_clear();
    writeln!(
        StandardOutput,
        "{}: whole, {:.1} MB",
        printable_text(&arguments.pack.display().to_string()),
        pack.len_bytes() as f64 / 1e6
    )?;
    Ok(Exit::Done)
}
