//! `grim map`: packs of map features.

use anyhow::Result;
use clap::Subcommand;

pub use super::map_build::build_with_bar;
use super::map_build::{self, BuildArgs};
use super::map_check::{self, CheckArgs};
use super::map_info::{self, InfoArgs, VerifyArgs};
use crate::exit::Exit;

/// Build a map pack from your own map, show what one holds, check one.
#[derive(Debug, Subcommand)]
pub enum MapCommand {
    /// Compute a map pack: the features of a map, once, for all photos
    ///
    /// Reads GeoTIFF and COG in any common projection, several of them (a folder, a .txt list, a .vrt), MBTiles, PMTiles, a
    /// folder of tiles, a picture with a world file (with --crs), a picture with --corners, or a CSV of pictures with
    /// corners. An interrupted build continues if the same command is given again.
    #[command(after_help = map_build::EXAMPLES)]
    Build(BuildArgs),
    /// Show what a map is, what its pack would take, and what looks wrong, before it is built
    ///
    /// Coordinate system, extent, ground resolution, a small picture on a terminal, number of tiles, size of the pack and time to
    /// build it here.
    #[command(after_help = map_check::EXAMPLES)]
    Check(CheckArgs),
    /// Show what a pack holds
    #[command(after_help = map_info::INFO_EXAMPLES)]
    Info(InfoArgs),
    /// Check every byte of a pack against its checksums
    ///
    /// Use it after copying a pack, or if answers look wrong.
    #[command(after_help = map_info::VERIFY_EXAMPLES)]
    Verify(VerifyArgs),
}

/// Runs the command.
///
/// # Errors
/// Unreadable map, model or pack; a pack that cannot be written.
pub fn run(command: MapCommand) -> Result<Exit> {
    match command {
        MapCommand::Build(arguments) => map_build::run(&arguments),
        MapCommand::Check(arguments) => map_check::run(&arguments),
        MapCommand::Info(arguments) => map_info::info(&arguments),
        MapCommand::Verify(arguments) => map_info::verify(&arguments),
    }
}
