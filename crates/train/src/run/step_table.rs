//! Tables of a run: CSV files in which each row belongs to a step.

use crate::error::TrainError;
use crate::run::run_folder::RunFolder;

/// A CSV file in the folder of a run. The first column is the step that a row was made at.
#[derive(Debug)]
pub struct StepTable {
    folder: RunFolder,
    name: &'static str,
    header: String,
    rows: Vec<String>,
}

/// The step of a row; `None` if the first column is no number.
fn step_of(row: &str) -> Option<f64> {
    row.split(',').next()?.parse().ok()
}

impl StepTable {
    /// The table in the file `name` with the columns of `header`, for a run that starts or resumes at `step`. Rows up to this step
    /// are kept if the file has the same columns. Others are removed: their steps are trained again, or belong to another run.
    ///
    /// # Errors
    /// [`TrainError::Io`] if the file cannot be read, [`TrainError::Output`] if it cannot be written.
    pub fn open(
        folder: &RunFolder,
        name: &'static str,
        header: &str,
        step: u64,
    ) -> Result<Self, TrainError> {
        let before = match fs_err::read(folder.path().join(name)) {
            Ok(bytes) => Some(String::from_utf8_lossy(&bytes).into_owned()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(error.into()),
        };
        let (columns, rows) = before
            .as_deref()
            .and_then(|text| text.split_once('\n'))
            .unwrap_or_default();
        let is_kept = |row: &&str| {
            columns == header
                && row.matches(',').count() == header.matches(',').count()
                && step_of(row).is_some_and(|of| of <= step as f64)
        };
        let out = Self {
            folder: folder.clone(),
            name,
            header: header.to_owned(),
            rows: rows
                .lines()
                .filter(is_kept)
                .map(ToOwned::to_owned)
                .collect(),
        };
        if before.is_some_and(|text| text != out.text()) {
            out.write()?;
        }
        Ok(out)
    }

    /// The rows, without the header.
    pub fn rows(&self) -> &[String] {
        &self.rows
    }

    /// Whether there is a row of this step.
    pub fn has_step(&self, step: u64) -> bool {
        let mut steps = self.rows.iter().filter_map(|row| step_of(row));
        steps.any(|of| of == step as f64)
    }

    /// Adds rows and rewrites the file.
    ///
    /// # Errors
    /// [`TrainError::Output`] if the file cannot be written.
    pub fn add(&mut self, rows: impl IntoIterator<Item = String>) -> Result<(), TrainError> {
        self.rows.extend(rows);
        self.write()
    }

    fn text(&self) -> String {
        let lines = std::iter::once(&self.header).chain(&self.rows);
        lines.flat_map(|line| [line, "\n"]).collect()
    }

    fn write(&self) -> Result<(), TrainError> {
        self.folder.write(self.name, self.text().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrainConfig;
    use crate::run::run_folder::VALIDATION;
    use grimnet_output::OutputPolicy;
    use std::path::Path;

    fn opened(path: &Path, header: &str, step: u64) -> StepTable {
        let config = TrainConfig {
            out: path.to_owned(),
            ..TrainConfig::default()
        };
        let folder = RunFolder::open(&config, &OutputPolicy::new()).unwrap();
        StepTable::open(&folder, VALIDATION, header, step).unwrap()
    }

    #[test]
    fn rows_of_steps_that_are_trained_again_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let text = || fs_err::read_to_string(folder.path().join(VALIDATION)).unwrap();
        let mut first = opened(folder.path(), "step,share", 0);
        for step in 1..=5 {
            first.add([format!("{step},0.5")]).unwrap();
        }
        drop(first);
        let mut resumed = opened(folder.path(), "step,share", 2);
        assert_eq!(text(), "step,share\n1,0.5\n2,0.5\n");
        assert!(resumed.has_step(2) && !resumed.has_step(3));
        resumed.add(["3,0.6".to_owned()]).unwrap();
        assert_eq!(text(), "step,share\n1,0.5\n2,0.5\n3,0.6\n");
    }

    #[test]
    fn rows_of_another_run_or_with_other_columns_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let text = || fs_err::read_to_string(folder.path().join(VALIDATION)).unwrap();
        let row = || ["4,0.5".to_owned()];
        opened(folder.path(), "step,share", 0).add(row()).unwrap();
        drop(opened(folder.path(), "step,share", 0));
        assert_eq!(text(), "step,share\n");
        opened(folder.path(), "step,share", 0).add(row()).unwrap();
        drop(opened(folder.path(), "step,other", 9));
        assert_eq!(text(), "step,other\n");
    }
}
