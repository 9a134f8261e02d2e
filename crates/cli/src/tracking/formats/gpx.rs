//! GPX 1.1: one track; a new segment begins where the position was not known.

use anyhow::Result;
use grimnet_answer::GpxTrack;

use super::super::line::TrackLine;
use crate::formats::TextFormat;

#[derive(Default)]
pub struct Gpx(GpxTrack);

impl TextFormat<TrackLine> for Gpx {
    fn opening(&self) -> String {
        self.0.opening()
    }

    fn row(&mut self, line: &TrackLine) -> Result<String> {
        Ok(self.0.point(line.place()))
    }

    fn closing(&self) -> &'static str {
        self.0.closing()
    }
}
