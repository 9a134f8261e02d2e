//! Where text that an option asks for goes.

use std::path::Path;

use anyhow::Result;
use grimnet_output::{OutputPolicy, PlannedOutput};

/// Standard output, or a file.
#[derive(Debug, Clone, Copy)]
pub enum TextTarget<'a> {
    /// Standard output, because `-` was given or because nothing was.
    StandardOutput {
        /// Whether it was asked for.
        is_given: bool,
    },
    /// A file.
    File(&'a Path),
}

impl<'a> TextTarget<'a> {
    /// What the value of an option names.
    pub fn of(value: Option<&'a Path>) -> Self {
        match value {
            Some(path) if path != Path::new("-") => Self::File(path),
            other => Self::StandardOutput {
                is_given: other.is_some(),
            },
        }
    }

    /// The file.
    pub fn file(self) -> Option<&'a Path> {
        match self {
            Self::File(path) => Some(path),
            Self::StandardOutput { .. } => None,
        }
    }

    /// Whether a person reads it.
    pub fn is_terminal(self) -> bool {
        self.file().is_none() && std::io::IsTerminal::is_terminal(&std::io::stdout())
    }

    /// Checks that it may be written, before the work.
    ///
    /// # Errors
    /// The file may not be replaced, or its folder not be written.
    pub fn check(self, policy: &OutputPolicy) -> Result<()> {
        match self {
            Self::File(path) => Ok(policy.check_file(path, &[])?),
            Self::StandardOutput { .. } => Ok(()),
        }
    }

    /// As one of the outputs of a run, which `option` asks for.
    pub fn planned(self, option: &str) -> PlannedOutput {
        match self {
            Self::File(path) => PlannedOutput::file(option, path),
            Self::StandardOutput { is_given: true } => PlannedOutput::standard_output(option),
            Self::StandardOutput { is_given: false } => PlannedOutput::standard_output(&format!(
                "the default of {option} (standard output; {option} FILE writes a file)"
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hyphen_is_standard_output_and_with_a_folder_a_file() {
        assert!(TextTarget::of(None).file().is_none());
        assert!(TextTarget::of(Some(Path::new("-"))).file().is_none());
        for name in ["./-", "a.csv"] {
            let path = Path::new(name);
            assert_eq!(TextTarget::of(Some(path)).file(), Some(path));
        }
    }
}
