//! `grim track --replay`.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Result, bail};
use grimnet_answer::printable;

use super::track_options::TrackArgs;
use super::track_output::{TRACK_SO_FAR, check_outputs, open_output};
use crate::exit::Exit;
use crate::formats::{RowOutput, stopped};
use crate::tracking::line::TrackLine;
use crate::tracking::recording::Replay;

/// Runs a recording again: a file, or the newest one of a folder.
///
/// # Errors
/// The recording cannot be read, or the track not be written.
pub fn replay(arguments: &TrackArgs, given: &Path) -> Result<Exit> {
    let recorded = Replay::open(given)?;
    let overwrite = arguments.output.overwrite;
    let policy = overwrite
        .policy()
        .protect(recorded.path())
        .protect_all(recorded.others());
    check_outputs(arguments, &policy)?;
    warn_of_others(&recorded);
    let stream = open_output(arguments, &policy)?;
    let partial = stream.partial_path();
    let (frames, others) =
        write_track(recorded, stream).map_err(|error| stopped(error, TRACK_SO_FAR, partial))?;
    if others > 0 {
        tracing::warn!("{others} of {frames} frames give another track than the recorded one");
        return Ok(Exit::SomeWithoutFix);
    }
    // There is nobody left to tell if standard error is gone.
    let _ = writeln!(
        std::io::stderr(),
        "{frames} frames, all as they were recorded"
    );
    Ok(Exit::Done)
}

/// Says which recording of the folder is taken, if there are several.
fn warn_of_others(recorded: &Replay) {
    let others = recorded.others().iter().map(|path| path.display());
    let others: Vec<String> = others.map(|path| path.to_string()).collect();
    if !others.is_empty() {
        tracing::warn!(
            "{} is replayed, which was written last; to replay another one, name its file: {}",
            recorded.path().display(),
            others.join(", ")
        );
    }
}

/// Writes the track of all frames. Gives their number, and the number of those that give another track than the recorded one.
fn write_track(mut recorded: Replay, mut stream: RowOutput<TrackLine>) -> Result<(usize, usize)> {
    let (mut frames, mut others) = (0, 0);
    while let Some(frame) = recorded.next_frame()? {
        frames += 1;
        if !frame.is_same {
            others += 1;
            if others == 1 {
                let photo = frame.line.photo();
                tracing::warn!(
                    "{}: frame {frames} ({}) gives another position than when it was recorded",
                    recorded.path().display(),
                    printable(photo)
                );
            }
        }
        stream.write(&frame.line)?;
    }
    if frames == 0 {
        bail!("{}: holds no frame", recorded.path().display());
    }
    stream.finish()?;
    Ok((frames, others))
}
