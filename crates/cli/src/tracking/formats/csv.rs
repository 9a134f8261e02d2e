//! Comma-separated values with a header.

use anyhow::Result;
use grimnet_answer::printable_text;

use super::super::line::{TrackLine, position_of_text, state_text};
use crate::formats::TextFormat;

const HEADER: &[&str] = &[
    "time",
    "photo",
    "state",
    "lat_deg",
    "lon_deg",
    "heading_deg",
    "radius95_m",
    "covariance_ee_m2",
    "covariance_en_m2",
    "covariance_nn_m2",
    "age_of_last_fix_s",
    "velocity_east_m_s",
    "velocity_north_m_s",
    "frame",
    "reason",
    "position_of",
];

pub struct Csv;

impl TextFormat<TrackLine> for Csv {
    fn opening(&self) -> String {
        HEADER.join(",") + "\n"
    }

    fn row(&mut self, line: &TrackLine) -> Result<String> {
        let text = |value: Option<f64>, decimals: usize| {
            value.map(|v| format!("{v:.decimals$}")).unwrap_or_default()
        };
        let covariance = |i: usize| text(line.covariance_en_m2.map(|c| c[i]), 6);
        let note = line.note.as_ref();
        let frame = note.map_or("", |note| note.frame.text());
        let mut writer = ::csv::Writer::from_writer(Vec::new());
        writer.write_record([
            line.time.to_string(),
            printable_text(line.photo()).into_owned(),
            state_text(line.state).to_owned(),
            text(line.lat_deg, 8),
            text(line.lon_deg, 8),
            text(line.heading_deg, 2),
            text(line.radius95_m, 3),
            covariance(0),
            covariance(1),
            covariance(2),
            text(line.age_of_last_fix_s, 3),
            text(line.velocity_east_m_s, 3),
            text(line.velocity_north_m_s, 3),
            frame.to_owned(),
            note.and_then(|note| note.reason.as_deref())
                .map_or_else(String::new, |reason| printable_text(reason).into_owned()),
            line.position_of.map_or("", position_of_text).to_owned(),
        ])?;
        Ok(String::from_utf8(writer.into_inner()?)?)
    }
}
