//! The folder of a run: its own files are replaced, files of others are not.

use std::path::Path;

use grimnet_output::{OutputFolder, OutputPolicy};

use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::run::checkpoint::{CHECKPOINT, Checkpoint};

/// The file of the exported model.
pub const MODEL: &str = "model.safetensors";
/// The table of reports.
pub const CURVES: &str = "curves.csv";
/// The plot of reports.
pub const CURVES_PLOT: &str = "curves.svg";
/// The table of validations.
pub const VALIDATION: &str = "validation.csv";
/// The table of the flight that is localised at validations.
pub const FLIGHT: &str = "flight.csv";

/// The output folder of a run, which no other run can open meanwhile.
#[derive(Debug, Clone)]
pub struct RunFolder {
    folder: OutputFolder,
}

impl RunFolder {
    /// Opens the folder `out` of a configuration, creates it if it does not exist, and checks that the files of a run may be written.
    /// Checkpoints are known by their header: one that was copied into the folder counts as the program's own.
    ///
    /// # Errors
    /// [`TrainError::Output`] if one of the files is there, was not written by a run and the policy does not allow to replace it, or is
    /// the file that the run starts from; if another run has the folder open; if it cannot be written.
    pub fn open(config: &TrainConfig, policy: &OutputPolicy) -> Result<Self, TrainError> {
        let policy = policy.clone().protect_all(&config.start_from);
        let folder = OutputFolder::open(&config.out, &policy)?;
        let checkpoint = config.out.join(CHECKPOINT);
        if checkpoint.is_file() && Checkpoint::is_checkpoint(&checkpoint)? {
            folder.record(CHECKPOINT)?;
        }
        folder.check([CHECKPOINT, MODEL, CURVES, CURVES_PLOT, VALIDATION, FLIGHT])?;
        Ok(Self { folder })
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes a file as a whole or not at all.
    ///
    /// # Errors
    /// [`TrainError::Output`].
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), TrainError> {
        Ok(self.folder.write_bytes(name, bytes)?)
    }

    /// Writes the exported model.
    ///
    /// # Errors
    /// [`TrainError::Output`].
    pub fn write_model(&self, model: &grimnet_net::Model) -> Result<(), TrainError> {
        Ok(self.folder.write(MODEL, |file| model.write(file))?)
    }
}
