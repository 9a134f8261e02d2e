//! The `grim` program: where on this map was this photo taken?

mod cli;
mod commands;
mod drawings;
mod formats;
mod localise;
mod own_pictures;
mod photos;
mod procedural_flight;
mod standard_output;
mod tracking;

use clap::Parser as _;
use grimnet_program::{errors, exit, inputs, interrupt, outputs, progress, values};

use crate::cli::Cli;
use crate::exit::Exit;

/// Messages without `-v`: warnings, and what a service answers.
const QUIET_FILTER: &str = "warn,grimnet_serve=info";

fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    cli.general
        .start(QUIET_FILTER)
        .and_then(|()| cli.run())
        .unwrap_or_else(|error| Exit::failure("grim", &error))
        .into()
}
