//! The `grim` program: where on this map was this photo taken?

mod cli;
mod commands;
mod drawings;
mod errors;
mod exit;
mod formats;
mod inputs;
mod interrupt;
mod localise;
mod outputs;
mod photos;
mod procedural_flight;
mod progress;
mod terminal;
mod tracking;
mod values;

use clap::Parser as _;

use crate::cli::Cli;
use crate::exit::Exit;

fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    start_log(cli.verbose);
    start_threads(cli.threads)
        .and_then(|()| cli.run())
        .unwrap_or_else(|error| Exit::failure(&error))
        .into()
}

fn start_log(verbose: u8) {
    let level = match verbose {
        // A service tells what it answers.
        0 => "warn,grimnet_serve=info",
        1 => "info",
        _ => "debug",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_env("GRIM_LOG")
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new(level));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(terminal::colours_on_stderr())
        .without_time()
        .with_target(false)
        .init();
}

fn start_threads(threads: Option<usize>) -> anyhow::Result<()> {
    if let Some(threads) = threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global()?;
    }
    Ok(())
}
