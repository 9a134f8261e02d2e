//! `grim track --replay`.

use std::path::Path;

use anyhow::{Result, bail};
use grimnet_answer::printable;

use super::track_options::TrackArgs;
use super::track_output::{check_outputs, open_output};
use crate::exit::Exit;
use crate::tracking::recording::Replay;

/// Runs a recording again.
///
/// # Errors
/// The recording cannot be read, or the track not be written.
pub fn replay(arguments: &TrackArgs, folder: &Path) -> Result<Exit> {
    let mut recorded = Replay::open(folder)?;
    let overwrite = arguments.output.overwrite;
    let policy = overwrite.policy().protect(recorded.path());
    check_outputs(arguments, &policy)?;
    let mut stream = open_output(arguments, &policy)?;
    let (mut frames, mut others) = (0, 0);
    while let Some(frame) = recorded.next_frame()? {
        frames += 1;
        if !frame.is_same {
            others += 1;
            if others == 1 {
                let photo = frame.line.photo();
                tracing::warn!(
                    "{}: frame {frames} ({}) gives another position than when it was recorded",
                    folder.display(),
                    printable(photo)
                );
            }
        }
        stream.write(&frame.line)?;
    }
    if frames == 0 {
        bail!("{}: holds no frame", folder.display());
    }
    stream.finish()?;
    if others > 0 {
        tracing::warn!("{others} of {frames} frames give another track than the recorded one");
        return Ok(Exit::SomeWithoutFix);
    }
    tracing::info!("{frames} frames, all as they were recorded");
    Ok(Exit::Done)
}
