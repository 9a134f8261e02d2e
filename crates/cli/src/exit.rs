//! Exit status of the program.

use std::io::Write as _;
use std::process::ExitCode;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// Everything was done.
    Done,
    /// It ran, and some photos have no fix.
    SomeWithoutFix,
    /// Wrong use, or input that cannot be read.
    Failed,
}

impl Exit {
    /// Tells the error and its causes on standard error.
    pub fn failure(error: &anyhow::Error) -> Self {
        let mut text = format!("grim: {error}");
        for cause in error.chain().skip(1) {
            let cause = cause.to_string();
            // Libraries often repeat their source in their own message.
            if !text.contains(&cause) {
                text.push_str(": ");
                text.push_str(&cause);
            }
        }
        // There is nobody left to tell if standard error is gone.
        let _ = writeln!(std::io::stderr(), "{text}");
        Self::Failed
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(match exit {
            Exit::Done => 0,
            Exit::SomeWithoutFix => 1,
            Exit::Failed => 2,
        })
    }
}
