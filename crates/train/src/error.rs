//! Errors of training.

use grimnet_net::NetError;
use grimnet_output::OutputError;
use std::path::{Path, PathBuf};

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A file or folder cannot be read or written. The message names it.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A value in the configuration is not usable.
    #[error("training configuration: {reason}")]
    Config {
        /// What is wrong and what is accepted.
        reason: String,
    },
    /// Not enough pictures.
    #[error(
        "found {found} usable training pictures in {folders}; at least {needed} are needed; {unreadable} cannot be read or are too small for `pairs.side_px`"
    )]
    TooFewPictures {
        /// Usable pictures.
        found: usize,
        /// Picture files that cannot be decoded or are too small.
        unreadable: usize,
        /// The folders.
        folders: String,
        /// How many are needed.
        needed: usize,
    },
    /// A data set's folder does not have the layout in the configuration.
    #[error("{path}: not a data set of `layout = \"{layout}\"`: {missing} is missing")]
    Layout {
        /// The data set's folder.
        path: PathBuf,
        /// The layout in the configuration.
        layout: &'static str,
        /// What is missing.
        missing: String,
    },
    /// No pairs could be made for a step.
    #[error(
        "step {step}: no pairs could be made: the pictures cannot be decoded or are too small for `pairs.side_px`, or `pairs.points` is more than both views share"
    )]
    NoPairs {
        /// The step.
        step: u64,
    },
    /// A checkpoint is damaged or belongs to another network.
    #[error("checkpoint {path}: {reason}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// The output folder holds the checkpoint of another run.
    #[error(
        "{}: a new run would replace this checkpoint of an earlier one, after {step} steps; resume it, choose another `out` folder, or allow overwriting",
        path.display()
    )]
    EarlierRun {
        /// The checkpoint.
        path: PathBuf,
        /// Steps of that run.
        step: u64,
    },
    /// Keypoint labels are missing or damaged.
    #[error("keypoint labels: {reason}")]
    Labels {
        /// What is wrong, and what to do.
        reason: String,
    },
    /// A weights file of another program cannot be used.
    #[error("weights {path}: {reason}")]
    Weights {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A loss or gradient is not finite.
    #[error("step {step}: {what} is not finite; {}", advice(checkpoint.as_deref()))]
    NotFinite {
        /// The step.
        step: u64,
        /// Which value.
        what: String,
        /// Where to resume from; `None` before the first checkpoint of the run.
        checkpoint: Option<PathBuf>,
    },
    /// An error of `grimnet-net`.
    #[error(transparent)]
    Net(#[from] NetError),
    /// Values cannot be read from the training device.
    #[error("cannot read values from the training device: {reason}")]
    Device {
        /// The device's message.
        reason: String,
    },
}

/// How to go on after a loss that is not finite.
fn advice(checkpoint: Option<&Path>) -> String {
    match checkpoint {
        Some(path) => format!(
            "resume from the last checkpoint, {}, with a lower learning rate",
            path.display()
        ),
        None => "start the run again with a lower learning rate".to_owned(),
    }
}
