//! OGC KML 2.3: one placemark; a new line begins where the position was not known.

use anyhow::Result;
use grimnet_answer::KmlTrack;

use super::super::line::TrackLine;
use crate::formats::TextFormat;

#[derive(Default)]
pub struct Kml(KmlTrack);

impl TextFormat<TrackLine> for Kml {
    fn opening(&self) -> String {
        self.0.opening().to_owned()
    }

    fn row(&mut self, line: &TrackLine) -> Result<String> {
        Ok(self.0.point(line.place()))
    }

    fn closing(&self) -> &'static str {
        self.0.closing()
    }
}
