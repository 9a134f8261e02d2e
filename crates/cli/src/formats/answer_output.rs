//! Where the answers of a run go.

use anyhow::Result;
use grimnet_answer::Answer;
use grimnet_output::OutputPolicy;

use super::{AnswerStream, Format, RowOutput, TextTarget};

/// Where the answers of a run go.
pub type AnswerOutput = RowOutput<Answer>;

impl AnswerOutput {
    /// Opens a file, or standard output.
    ///
    /// # Errors
    /// The file may not be replaced or cannot be written, or the format needs a file.
    pub fn open(format: Format, out: TextTarget<'_>, policy: &OutputPolicy) -> Result<Self> {
        #[cfg(feature = "sqlite")]
        if let (Format::Gpkg, Some(path)) = (format, out.file()) {
            return Self::database(
                |rows| Ok(grimnet_answer::geopackage_of(rows)?),
                path,
                policy,
            );
        }
        Ok(Self::Text(AnswerStream::answers_to(format, out, policy)?))
    }
}
