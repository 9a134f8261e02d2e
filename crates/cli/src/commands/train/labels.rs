//! `grim train CONFIG --labels`. The labels of each picture are saved when they are found, so that it can be interrupted.

use std::io::Write as _;
use std::path::Path;

use anyhow::Result;
use grimnet_train::{LabelProgress, TrainConfig, label_pictures};

use super::share_bar::share_bar;
use crate::exit::Exit;
use crate::standard_output::StandardOutput;

/// Labels the pictures of a configuration.
///
/// # Errors
/// Returns an error if the configuration has no `[labels]` table or no pictures, the detector cannot be opened or finds too few
/// keypoints, or the folder cannot be written.
pub(super) fn run(config_path: &Path, config: &TrainConfig) -> Result<Exit> {
    let bar = share_bar()?;
    let done = label_pictures(config, &config.device.device()?, &mut |progress| {
        bar.set_position((1000 * progress.labelled / progress.pictures.max(1)) as u64);
        bar.set_message(line(progress));
        if bar.is_hidden() {
            tracing::info!("{}", line(progress));
        }
        true
    })?;
    bar.finish_and_clear();
    let mut out = StandardOutput;
    writeln!(
        out,
        "{} pictures have labels, {} of them new; train with: grim train {}",
        done.labelled,
        done.of_this_run,
        config_path.display()
    )?;
    Ok(Exit::Done)
}

/// A report as one line.
fn line(p: &LabelProgress) -> String {
    format!(
        "{} of {} pictures, {:.0} keypoints a picture, {:.0} min left",
        p.labelled,
        p.pictures,
        p.keypoints_per_picture(),
        p.remaining_s / 60.0
    )
}
