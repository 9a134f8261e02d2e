//! Where the rows of a run go.

use std::path::{Path, PathBuf};

use anyhow::Result;
use grimnet_output::OutputPolicy;

use super::TextStream;

/// Rows as text, written one by one, or as a database that is written when the run ends.
pub enum RowOutput<'a, R> {
    /// Text.
    Text(TextStream<R>),
    /// A database.
    #[cfg_attr(
        not(feature = "sqlite"),
        allow(dead_code, reason = "builds without SQLite write no databases")
    )]
    Database(DatabaseOutput<'a, R>),
}

/// A database, its file, and what may be replaced.
pub struct DatabaseOutput<'a, R> {
    rows: Vec<R>,
    bytes_of: fn(&[R]) -> Result<Vec<u8>>,
    path: &'a Path,
    policy: &'a OutputPolicy,
}

impl<'a, R: Clone> RowOutput<'a, R> {
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
        path: &'a Path,
        policy: &'a OutputPolicy,
    ) -> Result<Self> {
        policy.check_file(path, &[])?;
        Ok(Self::Database(DatabaseOutput {
            rows: Vec::new(),
            bytes_of,
            path,
            policy,
        }))
    }

    /// Where the rows are until the run ends; `None` if they are written through, or kept in memory.
    pub fn partial_path(&self) -> Option<PathBuf> {
        match self {
            Self::Text(stream) => stream.partial_path(),
            Self::Database(_) => None,
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
            Self::Database(database) => {
                let bytes = (database.bytes_of)(&database.rows)?;
                database.policy.write(database.path, |file| {
                    std::io::Write::write_all(file, &bytes)
                })?;
                Ok(())
            }
        }
    }
}
