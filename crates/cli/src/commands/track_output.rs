//! Where the lines of `grim track` go.

use std::io::IsTerminal as _;

use anyhow::Result;
use grimnet_output::OutputPolicy;

use super::track_options::TrackArgs;
use crate::formats::TextStream;
use crate::tracking::formats::TrackFormat;
use crate::tracking::line::TrackLine;

/// Opens the file or standard output, in the format that is asked for, that the file's name says, or that fits a terminal.
///
/// # Errors
/// The file may not be written.
pub fn open_stream(arguments: &TrackArgs, policy: &OutputPolicy) -> Result<TextStream<TrackLine>> {
    let output = &arguments.output;
    let by_ending = || output.out.as_deref().and_then(TrackFormat::of);
    let format = output.format.or_else(by_ending).unwrap_or_else(|| {
        if output.out.is_none() && std::io::stdout().is_terminal() {
            TrackFormat::Table
        } else {
            TrackFormat::Jsonl
        }
    });
    match &output.out {
        Some(path) => TextStream::rows_to_file(format.start(), path, policy),
        None => Ok(TextStream::rows_to_stdout(format.start())),
    }
}
