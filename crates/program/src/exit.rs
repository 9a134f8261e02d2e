//! Exit status of the program.

use std::io::Write as _;
use std::process::ExitCode;

use crate::errors;
use grimnet_answer::printable_text;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// Everything was done.
    Done,
    /// It ran, and some photos have no fix.
    SomeWithoutFix,
    /// It ran, and something is left to be done by the user.
    Incomplete,
    /// Wrong use, or input that cannot be read.
    Failed,
    /// Stopped by Ctrl-C or SIGTERM; what was done until then is written.
    Interrupted,
}

impl Exit {
    /// Writes the error and its causes to standard error, after the name of the program. A reader of our output that went away
    /// (`| head`) is no error.
    pub fn failure(program: &str, error: &anyhow::Error) -> Self {
        if errors::is_broken_pipe(error) {
            return Self::Done;
        }
        let text = errors::message_with_hint(error);
        // There is nobody left to tell if standard error is gone.
        let _ = writeln!(std::io::stderr(), "{program}: {}", printable_text(&text));
        Self::Failed
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(match exit {
            Exit::Done => 0,
            Exit::SomeWithoutFix | Exit::Incomplete => 1,
            Exit::Failed => 2,
            // As a shell reports a process that SIGINT ended.
            Exit::Interrupted => 130,
        })
    }
}
