//! OGC KML 2.3: one placemark; a new line begins where the position was not known.

use std::fmt::Write as _;

use anyhow::Result;

use super::super::line::TrackLine;
use crate::formats::TextFormat;

#[derive(Default)]
pub struct Kml {
    /// Whether a line is open.
    open: bool,
    /// Whether it ends before the next point.
    interrupted: bool,
}

impl TextFormat<TrackLine> for Kml {
    fn opening(&self) -> String {
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <kml xmlns=\"http://www.opengis.net/kml/2.2\">\n\
         <Document>\n\
         <name>grimnet</name>\n\
         <Placemark>\n\
         <name>track</name>\n\
         <MultiGeometry>\n"
            .to_owned()
    }

    fn row(&mut self, line: &TrackLine) -> Result<String> {
        let Some([lon_deg, lat_deg]) = line.lon_lat_deg() else {
            self.interrupted = true;
            return Ok(String::new());
        };
        let mut text = String::new();
        if self.open && self.interrupted {
            text += "</coordinates></LineString>\n";
            self.open = false;
        }
        if !self.open {
            text += "<LineString><tessellate>1</tessellate><coordinates>\n";
            self.open = true;
        }
        self.interrupted = false;
        writeln!(text, "{lon_deg:.8},{lat_deg:.8}")?;
        Ok(text)
    }

    fn closing(&self) -> &'static str {
        if self.open {
            "</coordinates></LineString>\n</MultiGeometry>\n</Placemark>\n</Document>\n</kml>\n"
        } else {
            "</MultiGeometry>\n</Placemark>\n</Document>\n</kml>\n"
        }
    }
}
