//! `grim train`: only in builds with the trainer.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;

use crate::exit::Exit;

/// Arguments of `grim train`.
#[derive(Debug, Args)]
pub struct TrainArgs {
    /// What to train, on which pictures, for how long
    config: Option<PathBuf>,

    /// Go on from the last checkpoint
    #[arg(long)]
    resume: bool,
}

/// Says how to get the trainer.
///
/// # Errors
/// Always: this build has none.
pub fn run(_: &TrainArgs) -> Result<Exit> {
    anyhow::bail!(
        "this grim was built without the trainer, to keep the build short; build it with: cargo build --release -p grim --features train"
    )
}
