//! Where the answers of a run go.

use std::path::Path;

use anyhow::Result;
use grimnet_answer::Answer;
use grimnet_output::OutputPolicy;

use super::{AnswerStream, Format, RowOutput};

/// Where the answers of a run go.
pub type AnswerOutput<'a> = RowOutput<'a, Answer>;

impl<'a> AnswerOutput<'a> {
    /// Opens a file, or standard output.
    ///
    /// # Errors
    /// The file may not be replaced or cannot be written, or the format needs a file.
    pub fn open(format: Format, out: Option<&'a Path>, policy: &'a OutputPolicy) -> Result<Self> {
        Ok(match out {
            #[cfg(feature = "sqlite")]
            Some(path) if format == Format::Gpkg => Self::database(
                |rows| Ok(grimnet_answer::geopackage_of(rows)?),
                path,
                policy,
            )?,
            Some(path) => Self::Text(AnswerStream::to_file(format, path, policy)?),
            None => Self::Text(AnswerStream::to_stdout(format)?),
        })
    }
}
