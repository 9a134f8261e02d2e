//! `grim link`: the connection to an autopilot.

use anyhow::Result;
use clap::Subcommand;

use super::link_check::{self, CheckArgs};
use crate::exit::Exit;

/// Prepare the connection to an autopilot.
#[derive(Debug, Subcommand)]
pub enum LinkCommand {
    /// Read an autopilot's parameters and say which must change
    ///
    /// An autopilot drops positions without a word if its parameters do not ask for them. This reads them from ArduPilot or PX4
    /// and prints what to type. Nothing is changed.
    #[command(after_help = link_check::EXAMPLES)]
    Check(CheckArgs),
}

/// Runs the command.
///
/// # Errors
/// No autopilot is heard; a key that cannot be read.
pub fn run(command: LinkCommand) -> Result<Exit> {
    match command {
        LinkCommand::Check(arguments) => link_check::run(&arguments),
    }
}
