//! One JSON object per line.

use crate::answer::Answer;
use crate::error::Result;
use crate::format::AnswerFormat;

/// Writes [`Answer`]s as JSON lines.
#[derive(Debug, Clone, Copy)]
pub struct Jsonl;

impl AnswerFormat for Jsonl {
    fn answer(&mut self, answer: &Answer) -> Result<String> {
        Ok(serde_json::to_string(answer)? + "\n")
    }
}
