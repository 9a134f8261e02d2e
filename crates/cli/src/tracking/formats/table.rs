//! Aligned columns, for reading.

use std::path::Path;

use anyhow::Result;

use super::super::line::{TrackLine, state_text};
use crate::formats::{TextFormat, or_dash};
use grimnet_answer::{heading_or_dash, printable};

#[derive(Default)]
pub struct Table {
    lines: usize,
    usable: usize,
}

impl TextFormat<TrackLine> for Table {
    fn opening(&self) -> String {
        format!(
            "{:<24} {:<24} {:<10} {:>12} {:>13} {:>8} {:>8} {:>8}\n",
            "time", "photo", "state", "latitude", "longitude", "±95% m", "heading", "fix s"
        )
    }

    fn row(&mut self, line: &TrackLine) -> Result<String> {
        self.lines += 1;
        self.usable += usize::from(line.lat_deg.is_some());
        let name = Path::new(line.photo())
            .file_name()
            .map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        Ok(format!(
            "{:<24} {:<24} {:<10} {:>12} {:>13} {:>8} {:>8} {:>8}\n",
            line.time.to_string(),
            printable(&name),
            state_text(line.state),
            or_dash(line.lat_deg, 7),
            or_dash(line.lon_deg, 7),
            or_dash(line.radius95_m, 1),
            heading_or_dash(line.heading_deg),
            or_dash(line.age_of_last_fix_s, 1),
        ))
    }

    fn summary(&self) -> String {
        format!(
            "{} of {} instants with a position\n",
            self.usable, self.lines
        )
    }
}
