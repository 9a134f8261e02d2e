//! Where the lines of `grim track` go.

use std::io::IsTerminal as _;

use anyhow::{Context as _, Result};
use grimnet_output::OutputPolicy;

use super::track_options::TrackArgs;
use crate::formats::{NOT_TEXT, RowOutput, TextStream};
use crate::tracking::formats::TrackFormat;
use crate::tracking::line::TrackLine;

/// Opens the file or standard output, in the format that is asked for, that the file's name says, or that fits a terminal.
///
/// # Errors
/// The file may not be written, or the format needs a file.
pub fn open_output<'a>(
    arguments: &'a TrackArgs,
    policy: &'a OutputPolicy,
) -> Result<RowOutput<'a, TrackLine>> {
    let output = &arguments.output;
    let by_ending = || output.out.as_deref().and_then(TrackFormat::of);
    let format = output.format.or_else(by_ending).unwrap_or_else(|| {
        if output.out.is_none() && std::io::stdout().is_terminal() {
            TrackFormat::Table
        } else {
            TrackFormat::Jsonl
        }
    });
    #[cfg(feature = "sqlite")]
    if let (TrackFormat::Gpkg, Some(path)) = (format, &output.out) {
        return RowOutput::database(crate::tracking::formats::gpkg::bytes_of, path, policy);
    }
    let text = format.start().context(NOT_TEXT)?;
    Ok(RowOutput::Text(match &output.out {
        Some(path) => TextStream::rows_to_file(text, path, policy)?,
        None => TextStream::rows_to_stdout(text),
    }))
}
