//! One JSON object per line.

use anyhow::Result;

use super::super::line::TrackLine;
use crate::formats::TextFormat;

pub struct Jsonl;

impl TextFormat<TrackLine> for Jsonl {
    fn row(&mut self, line: &TrackLine) -> Result<String> {
        Ok(serde_json::to_string(line)? + "\n")
    }
}
