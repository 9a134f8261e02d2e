//! The folder of a run: its own files are replaced, files of others are not.

use std::path::Path;

use grimnet_output::{OutputFolder, OutputPolicy};

use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::run::checkpoint::{CHECKPOINT, Checkpoint, Position};

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
    /// a network that the run reads; if another run has the folder open; if it cannot be written.
    pub fn open(config: &TrainConfig, policy: &OutputPolicy) -> Result<Self, TrainError> {
        let teacher = config.teacher.as_ref().map(|teacher| &teacher.model);
        let detector = config.labels.as_ref().map(|labels| &labels.detector);
        let networks = [Some(&config.start_from), teacher, detector];
        let policy = policy
            .clone()
            .protect_all(networks.into_iter().flatten().flatten());
        let folder = OutputFolder::open(&config.out, &policy)?;
        let checkpoint = config.out.join(CHECKPOINT);
        if checkpoint.is_file() && Checkpoint::is_checkpoint(&checkpoint)? {
            folder.record(CHECKPOINT)?;
        }
        folder.check([CHECKPOINT, MODEL, CURVES, CURVES_PLOT, VALIDATION, FLIGHT])?;
        Ok(Self { folder })
    }

    /// Checks that a new run would replace no checkpoint of another.
    ///
    /// # Errors
    /// [`TrainError::EarlierRun`] if there is one that has made steps; [`TrainError::Io`].
    pub fn check_for_new_run(&self) -> Result<(), TrainError> {
        let path = self.path().join(CHECKPOINT);
        if !path.is_file() {
            return Ok(());
        }
        match Checkpoint::position_in(&path)? {
            Some(Position { step, .. }) if step > 0 => Err(TrainError::EarlierRun { path, step }),
            _ => Ok(()),
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::LabelOptions;
    use crate::model::teacher::TeacherOptions;
    use grimnet_output::OutputError;
    use std::path::PathBuf;

    #[test]
    fn networks_that_the_run_reads_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join(MODEL);
        std::fs::write(&model, "a network").unwrap();
        let with = |start_from: Option<PathBuf>, teacher, detector| {
            let config = TrainConfig {
                out: folder.path().to_owned(),
                start_from,
                teacher: Some(TeacherOptions {
                    model: teacher,
                    ..TeacherOptions::default()
                }),
                labels: Some(LabelOptions {
                    detector,
                    ..LabelOptions::default()
                }),
                ..TrainConfig::default()
            };
            RunFolder::open(&config, &OutputPolicy::new().overwrite(true)).map(drop)
        };
        assert!(with(None, None, None).is_ok());
        let model = Some(model);
        for refused in [
            with(model.clone(), None, None),
            with(None, model.clone(), None),
            with(None, None, model.clone()),
        ] {
            assert!(
                matches!(
                    refused,
                    Err(TrainError::Output(OutputError::ReplacesInput { .. }))
                ),
                "{refused:?}"
            );
        }
    }
}
