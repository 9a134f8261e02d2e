//! One JSON object per line.

use anyhow::Result;

use super::AnswerFormat;
use crate::answer::Answer;

pub struct Jsonl;

impl AnswerFormat for Jsonl {
    fn answer(&mut self, answer: &Answer) -> Result<String> {
        Ok(serde_json::to_string(answer)? + "\n")
    }
}
