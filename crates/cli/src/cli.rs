//! The command line.

use std::io::Write as _;

use anyhow::Result;
use clap::{Parser, Subcommand};
use grimnet_program::general::GeneralOptions;

use crate::commands::{
    calibrate, completions, demo, eval, link, locate, man, map, model, serve, track, train,
};
use crate::exit::Exit;
use crate::standard_output::StandardOutput;

/// Printed by `grim` without a command.
const BEGIN: &str = "\
grim says where on a map a drone photo was taken. Three commands to begin with:

  grim demo                                      # a procedural town, a flight over it, every photo located
  grim map build town.tif -o town.grim           # once for each map: compute its features
  grim locate --pack town.grim flight/*.jpg      # latitude and longitude of each photo

`grim serve --pack town.grim` opens a page for photos and the map. `grim --help` lists all commands, `grim COMMAND --help` explains one.
";

const EXAMPLES: &str = "\
Examples:
  grim demo
  grim map build town.tif -o town.grim
  grim locate --pack town.grim flight/*.jpg
  grim locate --pack town.grim a.jpg --heading unknown --height-agl 120 --hfov 73 --format jsonl

Exit status: 0 done, 1 some photos have no fix, 2 wrong use or input that cannot be read, 130 stopped by Ctrl-C.

Environment: GRIM_LOG filters messages (such as `debug`), NO_COLOR turns colours off.";

/// Where on this map was this photo taken?
///
/// grim compares a drone photo with a map and answers with latitude, longitude and a stated error radius, or with "no fix"
/// and the reason. It needs no GNSS and no network connection.
#[derive(Debug, Parser)]
#[command(name = "grim", version, after_help = EXAMPLES)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,

    #[command(flatten)]
    pub general: GeneralOptions,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Build a map pack from your own map, show what one holds, check one
    #[command(subcommand)]
    Map(map::MapCommand),
    /// Find where photos were taken
    #[command(after_help = locate::EXAMPLES)]
    Locate(locate::LocateArgs),
    /// Follow a flight: position, velocity and covariance over its frames
    #[command(after_help = track::EXAMPLES)]
    Track(Box<track::TrackArgs>),
    /// Answer photos over HTTP, with a page that shows them on the map
    #[command(after_help = serve::EXAMPLES)]
    Serve(serve::ServeArgs),
    /// Prepare the connection to an autopilot
    #[command(subcommand)]
    Link(link::LinkCommand),
    /// Measure accuracy on photos whose true position is known
    #[command(after_help = EVAL_EXAMPLES)]
    Eval(eval::EvalArgs),
    /// Fit the error radius and the confidence that a model states
    #[command(after_help = CALIBRATE_EXAMPLES)]
    Calibrate(Box<calibrate::CalibrateArgs>),
    /// Locate the photos of a flight over a procedural town; nothing to download
    #[command(after_help = demo::EXAMPLES)]
    Demo(demo::DemoArgs),
    /// Show what a model file holds
    #[command(subcommand)]
    Model(model::ModelCommand),
    /// Train a model on your own pictures
    #[command(after_help = TRAIN_EXAMPLES)]
    Train(train::TrainArgs),
    /// Print a completion script for a shell
    #[command(after_help = completions::EXAMPLES)]
    Completions(completions::CompletionsArgs),
    /// Write manual pages
    #[command(after_help = man::EXAMPLES)]
    Man(man::ManArgs),
}

const EVAL_EXAMPLES: &str = "\
Examples:
  grim eval flight --out results                 # flight/ holds map.tif, photos/ and truth.csv
  grim eval photos --map town.tif --out results  # true positions from the photos' EXIF
  grim eval --world 3 --out results              # a procedural world";

const CALIBRATE_EXAMPLES: &str = "\
Example:
  grim calibrate --model new.safetensors -o calibrated.safetensors --pictures aerial/";

const TRAIN_EXAMPLES: &str = "\
Examples:
  grim train training.toml
  grim train training.toml --resume
  grim train training.toml --export

TRAINING.md in the repository shows a configuration.";

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// As the command.
    pub fn run(self) -> Result<Exit> {
        let Some(command) = self.command else {
            StandardOutput.write_all(BEGIN.as_bytes())?;
            return Ok(Exit::Done);
        };
        match command {
            Command::Map(command) => map::run(command),
            Command::Locate(arguments) => locate::run(&arguments),
            Command::Track(arguments) => track::run(&arguments),
            Command::Serve(arguments) => serve::run(&arguments),
            Command::Link(command) => link::run(command),
            Command::Eval(arguments) => eval::run(&arguments),
            Command::Calibrate(arguments) => calibrate::run(&arguments),
            Command::Demo(arguments) => demo::run(&arguments),
            Command::Model(command) => model::run(command),
            Command::Train(arguments) => train::run(&arguments),
            Command::Completions(arguments) => completions::run::<Self>(&arguments),
            Command::Man(arguments) => man::run::<Self>(&arguments),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::{Command as Clap, CommandFactory as _};

    use super::*;

    fn program() -> Clap {
        let mut program = Cli::command().term_width(100).disable_help_subcommand(true);
        program.build();
        program
    }

    /// Calls `each` with every command below `command`, by its full name.
    fn visit(command: &Clap, each: &mut dyn FnMut(&str, &Clap)) {
        let name = command.get_display_name().unwrap_or("grim");
        each(name, command);
        for below in command.get_subcommands() {
            visit(below, each);
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        program().debug_assert();
    }

    #[test]
    fn help_of_every_command() {
        visit(&program(), &mut |name, command| {
            let help = command.clone().render_long_help().to_string();
            insta::assert_snapshot!(name, help);
        });
    }

    /// The words of the first `grim` in a line of an example, as a shell has them: without comment, redirection and other programs.
    fn words_of_grim(line: &str) -> Option<Vec<&str>> {
        let words = line
            .split_whitespace()
            .take_while(|word| !word.starts_with('#'));
        let mut words = words.skip_while(|word| *word != "grim");
        let grim = words.next()?;
        let arguments = words.take_while(|word| !["|", ">"].contains(word));
        Some(std::iter::once(grim).chain(arguments).collect())
    }

    #[test]
    fn examples_run_as_they_are_printed() {
        let mut found = 0;
        visit(&program(), &mut |name, command| {
            let text = command.get_after_help().map(ToString::to_string);
            let lines = text.iter().flat_map(|text| text.lines());
            for line in lines.filter(|line| line.starts_with("  ")) {
                let Some(words) = words_of_grim(line) else {
                    continue;
                };
                found += 1;
                if let Err(error) = Cli::try_parse_from(&words) {
                    panic!("{name}: {line}\n{error}");
                }
            }
        });
        for line in BEGIN.lines().filter(|line| line.starts_with("  ")) {
            let words = words_of_grim(line).unwrap();
            assert!(Cli::try_parse_from(words).is_ok(), "{line}");
        }
        assert!(found > 30, "{found}");
    }

    #[test]
    fn commands_beside_stored_figures_are_accepted() {
        let figures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../evaluation");
        let mut found = 0;
        for folder in [figures.clone(), figures.join("tracks")] {
            for entry in fs_err::read_dir(folder).unwrap() {
                let claim = entry.unwrap().path().join("claim.json");
                if !claim.is_file() {
                    continue;
                }
                let text = fs_err::read_to_string(claim).unwrap();
                let claim: serde_json::Value = serde_json::from_str(&text).unwrap();
                let command = claim["command"].as_str().unwrap();
                found += 1;
                if let Err(error) = Cli::try_parse_from(command.split_whitespace()) {
                    panic!("{command}\n{error}");
                }
            }
        }
        assert!(found >= 7, "{found}");
    }

    #[test]
    fn every_command_that_does_something_shows_an_example() {
        visit(&program(), &mut |name, command| {
            if command.get_subcommands().next().is_none() {
                let help = command.clone().render_long_help().to_string();
                let example = format!("\n  {}", name.replace('-', " "));
                assert!(help.contains(&example), "{name}: {help}");
            }
        });
    }
}
