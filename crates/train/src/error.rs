//! What can go wrong while training.

use crate::data::Layout;
use grimnet_net::NetError;
use std::path::PathBuf;

/// Why training, or a part of it, stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A file or folder cannot be read or written; the message of the operating system names it.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The configuration asks for something that cannot be done.
    #[error("the training configuration is wrong: {reason}")]
    Config {
        /// What, and what to write instead.
        reason: String,
    },
    /// Not enough pictures.
    #[error(
        "{found} usable pictures found ({unreadable} unreadable) under {folders}; at least {needed} are needed"
    )]
    TooFewPictures {
        /// Pictures that can be used.
        found: usize,
        /// Files that look like pictures and cannot be decoded or are too small.
        unreadable: usize,
        /// Where they were looked for.
        folders: String,
        /// How many are needed.
        needed: usize,
    },
    /// A data set is not laid out as its configuration says.
    #[error("{path} is not laid out as {layout:?} data: {missing} is missing")]
    Layout {
        /// The data set's folder.
        path: PathBuf,
        /// What was expected.
        layout: Layout,
        /// What is missing.
        missing: String,
    },
    /// The pictures or worlds gave no pairs.
    #[error(
        "step {step}: no pairs could be made; the pictures are too small for `pairs.side_px`, cannot be decoded, or `pairs.points` is too high for what both views see"
    )]
    NoPairs {
        /// The step.
        step: u64,
    },
    /// A checkpoint is damaged, or belongs to another network.
    #[error("checkpoint {path}: {reason}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// Keypoint labels are missing or damaged.
    #[error("keypoint labels: {reason}")]
    Labels {
        /// What is wrong, and what to do.
        reason: String,
    },
    /// A file of weights from another program cannot be used.
    #[error("weights {path}: {reason}")]
    Weights {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A loss or gradient is not a number.
    #[error(
        "step {step}: {what} is not finite; the last good checkpoint is {checkpoint}; resume from it with a lower learning rate"
    )]
    NotFinite {
        /// The step.
        step: u64,
        /// Which value.
        what: String,
        /// Where to resume from.
        checkpoint: String,
    },
    /// The model file's library refused.
    #[error(transparent)]
    Net(#[from] NetError),
    /// Values could not be read back from the device.
    #[error("values could not be read back from the training device: {reason}")]
    Device {
        /// What the device said.
        reason: String,
    },
}
