//! Where the rows of a run go.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use grimnet_output::{AtomicFile, OutputPolicy};

use super::TextStream;

/// Rows as text, written one by one, or as a database that is written when the run ends.
pub enum RowOutput<R> {
    /// Text.
    Text(TextStream<R>),
    /// A database.
    #[cfg_attr(
        not(feature = "sqlite"),
        allow(dead_code, reason = "builds without SQLite write no databases")
    )]
    Database(DatabaseOutput<R>),
}

/// A database and its file, which is `FILE.partial` until it is complete: what comes in its way in the meantime does not cost the rows.
pub struct DatabaseOutput<R> {
    rows: Vec<R>,
    bytes_of: fn(&[R]) -> Result<Vec<u8>>,
    file: AtomicFile,
}

impl<R: Clone> RowOutput<R> {
    /// A file that is made of all rows by `bytes_of`.
    ///
    /// # Errors
    /// The file may not be replaced.
    #[cfg_attr(
        not(feature = "sqlite"),
        allow(dead_code, reason = "builds without SQLite write no databases")
    )]
    pub fn database(
        bytes_of: fn(&[R]) -> Result<Vec<u8>>,
        path: &Path,
        policy: &OutputPolicy,
    ) -> Result<Self> {
        Ok(Self::Database(DatabaseOutput {
            rows: Vec::new(),
            bytes_of,
            file: policy.create_partial(path)?,
        }))
    }

    /// Where the rows are until the run ends, of a database when it is written; `None` if they are written through.
    pub fn partial_path(&self) -> Option<PathBuf> {
        match self {
            Self::Text(stream) => stream.partial_path(),
            Self::Database(database) => database.file.partial_path().map(Path::to_owned),
        }
    }

    /// Writes one row.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn write(&mut self, row: &R) -> Result<()> {
        match self {
            Self::Text(stream) => stream.write(row),
            Self::Database(database) => {
                database.rows.push(row.clone());
                Ok(())
            }
        }
    }

    /// Ends the text, or writes the database.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn finish(self) -> Result<()> {
        match self {
            Self::Text(stream) => stream.finish(),
            Self::Database(database) => database.finish(),
        }
    }
}

impl<R> DatabaseOutput<R> {
    fn finish(mut self) -> Result<()> {
        let bytes = (self.bytes_of)(&self.rows)?;
        let written = self.file.write_all(&bytes).and_then(|()| self.file.flush());
        if let Err(error) = written {
            // Nothing reads a part of a database; a device or pipe cannot be cut.
            let _ = self.file.cut_back(0);
            return Err(error.into());
        }
        Ok(self.file.commit()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_comes_in_the_way_does_not_cost_the_rows() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("answers.gpkg");
        let policy = OutputPolicy::new();
        let mut output =
            RowOutput::database(|rows: &[u8]| Ok(rows.to_vec()), &path, &policy).unwrap();
        let partial = output.partial_path().unwrap();
        output.write(&7).unwrap();
        fs_err::write(&path, "of somebody else").unwrap();
        output.write(&8).unwrap();
        assert!(output.finish().is_err());
        assert_eq!(fs_err::read(&path).unwrap(), b"of somebody else");
        assert_eq!(fs_err::read(&partial).unwrap(), [7, 8]);
    }
}
