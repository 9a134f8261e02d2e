//! The `grim` program: where on this map was this photo taken?

mod answer;
mod commands;
mod exit;
#[cfg(feature = "train")]
mod interrupt;
mod output;
mod photos;
mod progress;

use clap::{ArgAction, Parser, Subcommand};

use crate::exit::Exit;

const EXAMPLES: &str = "\
Examples:
  grim demo                                     a made-up town, a flight over it, every photo located
  grim map build town.tif -o town.grim          once: what the network sees of your map
  grim locate --pack town.grim flight/*.jpg     a latitude and longitude for each photo
  grim locate --pack town.grim a.jpg --heading unknown --height-agl 120 --hfov 73 --format jsonl

Exit status: 0 done, 1 some photos have no fix, 2 wrong use or unreadable input.";

/// Where on this map was this photo taken?
///
/// grim looks at a drone photo and a map, and answers with latitude, longitude and how sure it is, or
/// honestly with "no fix". No GNSS, no network connection.
#[derive(Debug, Parser)]
#[command(name = "grim", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,

    /// Say more: -v what is done, -vv every detail
    #[arg(short, long, action = ArgAction::Count, global = true)]
    verbose: u8,

    /// Threads to compute with [default: all cores]
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Build a map pack from your own map, or look into one
    #[command(subcommand)]
    Map(commands::map::MapCommand),
    /// Say where photos were taken
    Locate(commands::locate::LocateArgs),
    /// Measure accuracy on photos whose place is known
    Eval(commands::eval::EvalArgs),
    /// Fit how far a model's answers may be off, and how often they are wrong
    #[cfg(feature = "experiments")]
    Calibrate(commands::calibrate::CalibrateArgs),
    /// Fit how far a model's answers may be off, and how often they are wrong (needs --features experiments)
    #[cfg(not(feature = "experiments"))]
    Calibrate(commands::absent::AbsentArgs),
    /// Watch a flight over a made-up town being located
    Demo(commands::demo::DemoArgs),
    /// Look into a model file
    #[command(subcommand)]
    Model(commands::model::ModelCommand),
    /// Train a model on your own pictures
    Train(commands::train::TrainArgs),
}

fn main() -> std::process::ExitCode {
    let cli = Cli::parse();
    start_log(cli.verbose);
    let result = start_threads(cli.threads).and_then(|()| match cli.command {
        Command::Map(command) => commands::map::run(command),
        Command::Locate(arguments) => commands::locate::run(&arguments),
        Command::Eval(arguments) => commands::eval::run(&arguments),
        #[cfg(feature = "experiments")]
        Command::Calibrate(arguments) => commands::calibrate::run(&arguments),
        #[cfg(not(feature = "experiments"))]
        Command::Calibrate(_) => Err(anyhow::anyhow!(commands::absent::message(
            "grim calibrate",
            "experiments"
        ))),
        Command::Demo(arguments) => commands::demo::run(&arguments),
        Command::Model(command) => commands::model::run(command),
        Command::Train(arguments) => commands::train::run(&arguments),
    });
    result.unwrap_or_else(|error| Exit::failure(&error)).into()
}

fn start_log(verbose: u8) {
    let level = match verbose {
        0 => "warn",
        1 => "info",
        _ => "debug",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_env("GRIM_LOG")
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new(level));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
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
