//! Where the answers of a run go.

use std::path::{Path, PathBuf};

use anyhow::Result;
use grimnet_answer::Answer;
use grimnet_output::OutputPolicy;

use super::{AnswerStream, Format};

/// Answers as text, written one by one, or as a database that is written when the run ends.
pub enum AnswerOutput<'a> {
    /// Text.
    Text(AnswerStream),
    /// A GeoPackage, its file, and what may be replaced.
    #[cfg(feature = "sqlite")]
    GeoPackage(Vec<Answer>, &'a Path, &'a OutputPolicy),
    /// Ties the lifetime where there are no databases.
    #[cfg(not(feature = "sqlite"))]
    Never(std::convert::Infallible, std::marker::PhantomData<&'a Path>),
}

impl<'a> AnswerOutput<'a> {
    /// Opens a file, or standard output.
    ///
    /// # Errors
    /// The file may not be replaced or cannot be written, or the format needs a file.
    pub fn open(format: Format, out: Option<&'a Path>, policy: &'a OutputPolicy) -> Result<Self> {
        let stream = match out {
            #[cfg(feature = "sqlite")]
            Some(path) if format == Format::Gpkg => {
                policy.check_file(path, &[])?;
                return Ok(Self::GeoPackage(Vec::new(), path, policy));
            }
            Some(path) => AnswerStream::to_file(format, path, policy)?,
            None => AnswerStream::to_stdout(format)?,
        };
        Ok(Self::Text(stream))
    }

    /// Where the answers are until the run ends; `None` if they are written through, or kept in memory.
    pub fn partial_path(&self) -> Option<PathBuf> {
        match self {
            Self::Text(stream) => stream.partial_path(),
            _ => None,
        }
    }

    /// Writes one answer.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn write(&mut self, answer: &Answer) -> Result<()> {
        match self {
            Self::Text(stream) => stream.write(answer),
            #[cfg(feature = "sqlite")]
            Self::GeoPackage(answers, ..) => {
                answers.push(answer.clone());
                Ok(())
            }
            #[cfg(not(feature = "sqlite"))]
            Self::Never(never, _) => match *never {},
        }
    }

    /// Ends the text, or writes the database.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn finish(self) -> Result<()> {
        match self {
            Self::Text(stream) => stream.finish(),
            #[cfg(feature = "sqlite")]
            Self::GeoPackage(answers, path, policy) => {
                let bytes = grimnet_answer::geopackage_of(&answers)?;
                policy.write(path, |file| std::io::Write::write_all(file, &bytes))?;
                Ok(())
            }
            #[cfg(not(feature = "sqlite"))]
            Self::Never(never, _) => match never {},
        }
    }
}
