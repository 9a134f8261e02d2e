//! `grim completions`: completion scripts for shells.

use std::io::Write as _;

use anyhow::Result;
use clap::{Args, CommandFactory};
use clap_complete::Shell;

use crate::exit::Exit;
use crate::standard_output::StandardOutput;

/// Examples under the help of `grim completions`.
pub const EXAMPLES: &str = "\
Examples:
  grim completions bash > ~/.local/share/bash-completion/completions/grim
  grim completions zsh > ~/.zfunc/_grim               # with fpath+=~/.zfunc before compinit in ~/.zshrc
  grim completions fish > ~/.config/fish/completions/grim.fish";

/// Arguments of `grim completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the completion script of a shell for the program `P`.
///
/// # Errors
/// Standard output cannot be written.
pub fn run<P: CommandFactory>(arguments: &CompletionsArgs) -> Result<Exit> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut P::command(), "grim", &mut script);
    StandardOutput.write_all(&script)?;
    Ok(Exit::Done)
}
