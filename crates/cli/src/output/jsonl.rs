//! One JSON object a line.

use std::io::Write;

use anyhow::Result;

use super::AnswerWriter;
use crate::answer::Answer;

pub struct Jsonl<'a> {
    out: Box<dyn Write + 'a>,
}

impl<'a> Jsonl<'a> {
    pub fn new(out: Box<dyn Write + 'a>) -> Self {
        Self { out }
    }
}

impl AnswerWriter for Jsonl<'_> {
    fn write(&mut self, answer: &Answer) -> Result<()> {
        serde_json::to_writer(&mut self.out, answer)?;
        writeln!(self.out)?;
        self.out.flush()?;
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        Ok(())
    }
}
