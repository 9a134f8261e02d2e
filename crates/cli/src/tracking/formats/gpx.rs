//! GPX 1.1: one track; a new segment begins where the position was not known.

use std::fmt::Write as _;

use anyhow::Result;

use super::super::line::TrackLine;
use crate::formats::TextFormat;

#[derive(Default)]
pub struct Gpx {
    /// Whether a segment is open.
    open: bool,
    /// Whether it ends before the next point.
    interrupted: bool,
}

impl TextFormat<TrackLine> for Gpx {
    fn opening(&self) -> String {
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <gpx version=\"1.1\" creator=\"grim\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n\
         <trk>\n"
            .to_owned()
    }

    fn row(&mut self, line: &TrackLine) -> Result<String> {
        let Some([lon_deg, lat_deg]) = line.lon_lat_deg() else {
            self.interrupted = true;
            return Ok(String::new());
        };
        let mut text = String::new();
        if self.open && self.interrupted {
            text += "</trkseg>\n";
            self.open = false;
        }
        if !self.open {
            text += "<trkseg>\n";
            self.open = true;
        }
        self.interrupted = false;
        write!(text, "<trkpt lat=\"{lat_deg:.8}\" lon=\"{lon_deg:.8}\">")?;
        if let Some(altitude_m) = line.altitude_amsl_m {
            write!(text, "<ele>{altitude_m:.2}</ele>")?;
        }
        if let Some(date) = line.time.date() {
            write!(text, "<time>{date}</time>")?;
        }
        text += "</trkpt>\n";
        Ok(text)
    }

    fn closing(&self) -> &'static str {
        if self.open {
            "</trkseg>\n</trk>\n</gpx>\n"
        } else {
            "</trk>\n</gpx>\n"
        }
    }
}
