//! An output of a flight whose reader may go away, such as `head` behind a pipe.

use anyhow::Result;

use crate::errors;

/// An output that is given up when nothing reads it any more, if the flight has others.
pub struct WhileRead<O> {
    /// `None` once it is given up.
    output: Option<O>,
    /// What it holds, for the warning.
    what: &'static str,
    /// Whether the flight goes on without it.
    is_one_of_several: bool,
}

impl<O> WhileRead<O> {
    /// The output of `what`. Where it is the only one, that nothing reads it is an error.
    pub fn new(output: O, what: &'static str, is_one_of_several: bool) -> Self {
        Self {
            output: Some(output),
            what,
            is_one_of_several,
        }
    }

    /// Writes to it, unless it was given up.
    ///
    /// # Errors
    /// It cannot be written, or is the only one and not read any more.
    pub fn write(&mut self, write: impl FnOnce(&mut O) -> Result<()>) -> Result<()> {
        let written = self.output.as_mut().map_or(Ok(()), write);
        self.give_up_unread(written)
    }

    /// Ends it, unless it was given up.
    ///
    /// # Errors
    /// As [`WhileRead::write`].
    pub fn finish(mut self, finish: impl FnOnce(O) -> Result<()>) -> Result<()> {
        let finished = self.output.take().map_or(Ok(()), finish);
        self.give_up_unread(finished)
    }

    fn give_up_unread(&mut self, written: Result<()>) -> Result<()> {
        match written {
            Err(error) if self.is_one_of_several && errors::is_broken_pipe(&error) => {
                self.output = None;
                tracing::warn!(
                    "nothing reads {} any more; the flight goes on without, for its other outputs",
                    self.what
                );
                Ok(())
            }
            written => written,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;

    fn refused(kind: ErrorKind) -> Result<()> {
        Err(std::io::Error::from(kind).into())
    }

    #[test]
    fn an_output_that_nothing_reads_is_given_up_where_there_are_others() {
        let mut rows = WhileRead::new((), "the rows", true);
        rows.write(|()| refused(ErrorKind::BrokenPipe)).unwrap();
        rows.write(|()| panic!("it was given up")).unwrap();
        rows.finish(|()| panic!("it was given up")).unwrap();
        let last = WhileRead::new((), "the rows", true);
        last.finish(|()| refused(ErrorKind::BrokenPipe)).unwrap();
        let mut alone = WhileRead::new((), "the rows", false);
        assert!(alone.write(|()| refused(ErrorKind::BrokenPipe)).is_err());
        let mut full = WhileRead::new((), "the rows", true);
        assert!(full.write(|()| refused(ErrorKind::StorageFull)).is_err());
    }
}
