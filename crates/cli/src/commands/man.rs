//! `grim man`: manual pages.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Command, CommandFactory};
use grimnet_output::OutputFolder;

use crate::exit::Exit;
use crate::outputs::OverwriteChoice;
use crate::standard_output::StandardOutput;
use crate::values;
use grimnet_answer::printable;

/// Examples under the help of `grim man`.
pub const EXAMPLES: &str = "\
Example:
  grim man ~/.local/share/man/man1        # then: man grim, man grim-locate";

/// Arguments of `grim man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Folder for grim.1, grim-locate.1 and so on
    #[arg(value_name = "DIR", value_parser = values::output_folder())]
    folder: PathBuf,

    #[command(flatten)]
    overwrite: OverwriteChoice,
}

/// Writes a manual page for the program `P` and each of its commands.
///
/// # Errors
/// The folder cannot be written.
pub fn run<P: CommandFactory>(arguments: &ManArgs) -> Result<Exit> {
    let folder = OutputFolder::open(&arguments.folder, &arguments.overwrite.policy())?;
    let mut program = P::command().disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    collect(&program, &mut pages)?;
    folder.check(pages.iter().map(|(name, _)| name))?;
    for (name, page) in &pages {
        folder.write_bytes(name, page)?;
    }
    writeln!(
        StandardOutput,
        "{}: {} manual pages",
        printable(&arguments.folder.display().to_string()),
        pages.len()
    )?;
    Ok(Exit::Done)
}

/// File name and text of the page of a command and of those below it. Their display names, such as `grim-map-build`, are
/// set when the program is built.
fn collect(command: &Command, pages: &mut Vec<(String, Vec<u8>)>) -> Result<()> {
    let name = command
        .get_display_name()
        .unwrap_or_else(|| command.get_name());
    let mut page = Vec::new();
    let source = concat!("grim ", env!("CARGO_PKG_VERSION"));
    clap_mangen::Man::new(command.clone())
        .source(source)
        .render(&mut page)?;
    pages.push((format!("{name}.1"), page));
    for below in command.get_subcommands().filter(|c| !c.is_hide_set()) {
        collect(below, pages)?;
    }
    Ok(())
}
