//! Arguments of `grim train`.

use std::path::PathBuf;

use clap::Args;

use crate::commands::LimitsChoice;
use crate::outputs::OverwriteChoice;

/// Arguments of `grim train`.
#[derive(Debug, Args)]
#[cfg_attr(
    not(feature = "train"),
    allow(dead_code, reason = "this build has no trainer")
)]
pub struct TrainArgs {
    /// Training configuration (TOML; see TRAINING.md)
    pub(super) config: Option<PathBuf>,

    /// Resume from the last checkpoint; without it, a folder that holds a run is refused unless --overwrite is given
    #[arg(long)]
    pub(super) resume: bool,

    /// Do not train: label the pictures by homographic adaptation, with the settings of the table `labels`; pictures that have
    /// labels are skipped
    #[arg(long, conflicts_with_all = ["resume", "export"])]
    pub(super) labels: bool,

    /// Do not train: export the model of the last checkpoint
    #[arg(long, conflicts_with = "resume")]
    pub(super) export: bool,

    #[command(flatten)]
    pub(super) limits: LimitsChoice,

    #[command(flatten)]
    pub(super) overwrite: OverwriteChoice,
}
