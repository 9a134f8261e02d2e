//! The program `grim-experiments`: the tables of the GRiM-Net publication, robustness sweeps, and retrieval among distractors.

mod arguments;
mod conditions;
mod named;
mod run;
mod scenes;
mod training;

use clap::Parser as _;
use grimnet_program::exit::Exit;

use crate::arguments::Arguments;

fn main() -> std::process::ExitCode {
    let arguments = Arguments::parse();
    arguments
        .general
        .start("warn")
        .and_then(|()| run::run(&arguments))
        .unwrap_or_else(|error| Exit::failure("grim-experiments", &error))
        .into()
}
