//! `grim train`: only in builds with the trainer.

use std::path::PathBuf;

use clap::Args;

#[cfg(feature = "train")]
mod flight_log;
#[cfg(feature = "train")]
mod labels;
#[cfg(feature = "train")]
mod session;
#[cfg(feature = "train")]
pub use session::run;

/// Arguments of `grim train`.
#[derive(Debug, Args)]
pub struct TrainArgs {
    /// What to train, on which pictures, for how long (TOML)
    config: Option<PathBuf>,

    /// Go on from the last checkpoint
    #[arg(long)]
    resume: bool,

    /// Train nothing: find keypoints in the pictures by homographic adaptation, as the table `labels` says; what was found by
    /// an earlier run is kept
    #[arg(long, conflicts_with_all = ["resume", "export"])]
    labels: bool,

    /// Train no more: make the model file of the last checkpoint
    #[arg(long, conflicts_with = "resume")]
    export: bool,
}

/// Says how to get the trainer.
///
/// # Errors
/// Always: this build has none.
#[cfg(not(feature = "train"))]
pub fn run(_: &TrainArgs) -> anyhow::Result<crate::exit::Exit> {
    anyhow::bail!(
        "this grim was built without the trainer, to keep the build short; build it with: cargo build --release -p grimnet-cli --features train"
    )
}
