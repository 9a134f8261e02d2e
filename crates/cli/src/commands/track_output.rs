//! Where `grim track` writes to.

use anyhow::{Context as _, Result};
use grimnet_output::{OutputPolicy, PlannedOutput, check_apart};
use grimnet_track::TrackPoint;

use super::track_options::TrackArgs;
use super::track_reader::WhileRead;
use super::track_report::PAGE;
use crate::formats::{NOT_TEXT, RowOutput, TextStream, TextTarget, warn_of_ending};
use crate::tracking::formats::TrackFormat;
use crate::tracking::line::TrackLine;
use crate::tracking::nmea_rows::NmeaRows;
use crate::tracking::recording::FLIGHT_FILE;

/// Checks, before anything is read, that the outputs do not meet and that files may be written. Folders are checked when they are
/// opened.
///
/// # Errors
/// Two of them would be written to the same place, or a file may not be written.
pub fn check_outputs(arguments: &TrackArgs, policy: &OutputPolicy) -> Result<()> {
    let output = &arguments.output;
    let track = track_target(arguments);
    let nmea = arguments.link.nmea_target();
    let mut planned = vec![track.planned("--out")];
    planned.extend(nmea.map(|target| target.planned("--nmea")));
    let folders = [
        ("--report", &output.report, PAGE),
        ("--record", &output.record, FLIGHT_FILE),
    ];
    for (option, folder, name) in folders {
        planned.extend(
            folder
                .iter()
                .map(|path| PlannedOutput::folder(option, path, [name])),
        );
    }
    let session = output.session.as_deref();
    planned.extend(session.map(|path| PlannedOutput::file("--session", path)));
    check_apart(&planned)?;
    for target in [track].into_iter().chain(nmea) {
        target.check(policy)?;
    }
    if let Some(path) = session {
        policy.check_file(path, &[])?;
    }
    Ok(())
}

/// What is said of the file that holds a track that was stopped.
pub const TRACK_SO_FAR: &str = "the track so far is in";

fn track_target(arguments: &TrackArgs) -> TextTarget<'_> {
    TextTarget::of(arguments.output.out.as_deref())
}

/// Opens the file or standard output for the track, in the format that is asked for, that the file's name says, or that fits a
/// terminal.
///
/// # Errors
/// The file may not be written, or the format needs a file.
pub fn open_output(arguments: &TrackArgs, policy: &OutputPolicy) -> Result<RowOutput<TrackLine>> {
    let target = track_target(arguments);
    let by_ending = target.file().and_then(TrackFormat::of);
    if let Some(file) = target.file() {
        warn_of_ending(file, by_ending, arguments.output.format);
    }
    let format = arguments.output.format.or(by_ending);
    let format = format.unwrap_or_else(|| {
        if target.is_terminal() {
            TrackFormat::Table
        } else {
            TrackFormat::Jsonl
        }
    });
    #[cfg(feature = "sqlite")]
    if let (TrackFormat::Gpkg, Some(path)) = (format, target.file()) {
        return RowOutput::database(crate::tracking::formats::gpkg::bytes_of, path, policy);
    }
    let text = format.start().context(NOT_TEXT)?;
    Ok(RowOutput::Text(TextStream::rows_to(text, target, policy)?))
}

/// The rows of the track: of a flight that has other outputs or links, the end of whoever reads them is not its end.
pub fn while_read(
    rows: RowOutput<TrackLine>,
    arguments: &TrackArgs,
) -> WhileRead<RowOutput<TrackLine>> {
    let TrackArgs { link, output, .. } = arguments;
    let has_link = link.mavlink.is_some() || link.nmea.is_some();
    let has_file = output.record.is_some() || output.report.is_some() || output.session.is_some();
    WhileRead::new(rows, "the rows of the track", has_link || has_file)
}

/// Opens the file or standard output for NMEA sentences, if they are asked for there.
///
/// # Errors
/// The file may not be written.
pub fn open_nmea(
    arguments: &TrackArgs,
    policy: &OutputPolicy,
) -> Result<Option<WhileRead<TextStream<TrackPoint>>>> {
    let target = arguments.link.nmea_target();
    let stream = target.map(|target| TextStream::rows_to(Box::new(NmeaRows), target, policy));
    // The track is written beside them.
    let while_read = |stream| WhileRead::new(stream, "the sentences of --nmea", true);
    Ok(stream.transpose()?.map(while_read))
}
