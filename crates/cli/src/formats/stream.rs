//! Answers written one by one, so that a long run shows what it has and a killed one keeps it.

use std::io::{Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use grimnet_answer::{Answer, AnswerFormat};
use grimnet_output::{AtomicFile, OutputPolicy};

use super::{Format, NOT_TEXT, TextTarget};
use crate::standard_output::StandardOutput;

/// The text of rows of one kind, in pieces: opening, rows, closing.
pub trait TextFormat<R> {
    /// What stands before the first row.
    fn opening(&self) -> String {
        String::new()
    }

    /// One row.
    ///
    /// # Errors
    /// The row cannot be written in this format.
    fn row(&mut self, row: &R) -> Result<String>;

    /// What has to follow the last row for the text to be well-formed.
    fn closing(&self) -> &'static str {
        ""
    }

    /// What is said at the end of a whole run.
    fn summary(&self) -> String {
        String::new()
    }
}

impl TextFormat<Answer> for Box<dyn AnswerFormat> {
    fn opening(&self) -> String {
        self.as_ref().opening()
    }

    fn row(&mut self, answer: &Answer) -> Result<String> {
        Ok(self.as_mut().answer(answer)?)
    }

    fn closing(&self) -> &'static str {
        self.as_ref().closing()
    }

    fn summary(&self) -> String {
        self.as_ref().summary()
    }
}

/// Where answers go as they come.
pub type AnswerStream = TextStream<Answer>;

/// Where rows go as they come.
///
/// In a file, the text is well-formed after every row: the closing is written behind each row and overwritten by
/// the next one. The file is `FILE.partial` until the run ends.
pub struct TextStream<R> {
    format: Box<dyn TextFormat<R>>,
    out: Out,
    opened: bool,
    /// Bytes of a file up to the closing.
    end: u64,
}

enum Out {
    Stdout(StandardOutput),
    File(AtomicFile),
}

impl AnswerStream {
    /// Answers go to a file or standard output.
    ///
    /// # Errors
    /// The format is not text; as [`TextStream::rows_to`].
    pub fn answers_to(format: Format, out: TextTarget<'_>, policy: &OutputPolicy) -> Result<Self> {
        let format = format.start().context(NOT_TEXT)?;
        Self::rows_to(Box::new(format), out, policy)
    }
}

impl<R> TextStream<R> {
    /// Rows go to a file or standard output.
    ///
    /// # Errors
    /// The file may not be replaced, or nothing can be written there.
    pub fn rows_to(
        format: Box<dyn TextFormat<R>>,
        out: TextTarget<'_>,
        policy: &OutputPolicy,
    ) -> Result<Self> {
        Ok(Self {
            format,
            out: match out {
                TextTarget::StandardOutput { .. } => Out::Stdout(StandardOutput),
                TextTarget::File(path) => Out::File(policy.create_partial(path)?),
            },
            opened: false,
            end: 0,
        })
    }

    /// Where the rows are until the run ends; `None` if they are written through.
    pub fn partial_path(&self) -> Option<PathBuf> {
        match &self.out {
            Out::Stdout(_) => None,
            Out::File(file) => file.partial_path().map(Path::to_owned),
        }
    }

    /// Writes one row.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn write(&mut self, row: &R) -> Result<()> {
        let mut text = self.opening();
        text += &self.format.row(row)?;
        let closing = self.format.closing();
        match &mut self.out {
            // What was written to a pipe cannot be taken back: the closing waits for the end.
            Out::File(file) if file.partial_path().is_some() => {
                text += closing;
                let written = file
                    .write_all(text.as_bytes())
                    .and_then(|()| file.seek(SeekFrom::Current(-(closing.len() as i64))));
                match written {
                    Ok(end) => self.end = end,
                    Err(error) => {
                        // As on a full disk: without the row the text is well-formed, and its closing had room before.
                        file.cut_back(self.end)?;
                        if self.end > 0 {
                            file.write_all(closing.as_bytes())?;
                        }
                        return Err(error.into());
                    }
                }
            }
            out => out.write(&text)?,
        }
        Ok(())
    }

    /// Writes what ends the text, and puts a file in its place.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn finish(mut self) -> Result<()> {
        let mut text = self.opening();
        text += self.format.closing();
        text += &self.format.summary();
        self.out.write(&text)?;
        match self.out {
            Out::Stdout(_) => {}
            Out::File(file) => file.commit()?,
        }
        Ok(())
    }

    /// The opening, once.
    fn opening(&mut self) -> String {
        if std::mem::replace(&mut self.opened, true) {
            String::new()
        } else {
            self.format.opening()
        }
    }
}

impl Out {
    fn write(&mut self, text: &str) -> std::io::Result<()> {
        let write = |out: &mut dyn Write| {
            out.write_all(text.as_bytes())?;
            out.flush()
        };
        match self {
            Self::Stdout(out) => write(out),
            Self::File(file) => write(file),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::tests::answers;

    #[test]
    fn the_partial_file_is_well_formed_after_every_answer() {
        let folder = tempfile::tempdir().unwrap();
        for (format, name) in [
            (Format::Geojson, "a.geojson"),
            (Format::Kml, "a.kml"),
            (Format::Csv, "a.csv"),
            (Format::Jsonl, "a.jsonl"),
        ] {
            let path = folder.path().join(name);
            let partial = folder.path().join(format!("{name}.partial"));
            let target = TextTarget::File(&path);
            let mut stream =
                AnswerStream::answers_to(format, target, &OutputPolicy::new()).unwrap();
            for (i, answer) in answers().iter().enumerate() {
                stream.write(answer).unwrap();
                assert!(!path.exists());
                let text = fs_err::read_to_string(&partial).unwrap();
                assert_eq!(text, format.text_of(&answers()[..=i]).unwrap(), "{name}");
            }
            stream.finish().unwrap();
            let text = fs_err::read_to_string(&path).unwrap();
            assert_eq!(text, format.text_of(&answers()).unwrap());
            assert!(!partial.exists());
        }
    }
}
