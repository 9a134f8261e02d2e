//! Comma-separated values with a header.

use crate::answer::{Answer, State};
use crate::error::{AnswerError, Result};
use crate::format::AnswerFormat;
use crate::printable::printable_text;

const HEADER: &[&str] = &[
    "photo",
    "state",
    "lat_deg",
    "lon_deg",
    "heading_deg",
    "gsd_m",
    "radius95_m",
    "covariance_ee_m2",
    "covariance_en_m2",
    "covariance_nn_m2",
    "confidence",
    "inliers",
    "reason",
    "total_ms",
    "damaged",
    "check_m",
];

/// Writes [`Answer`]s as comma-separated values.
#[derive(Debug, Clone, Copy)]
pub struct Csv;

impl AnswerFormat for Csv {
    fn opening(&self) -> String {
        HEADER.join(",") + "\n"
    }

    fn answer(&mut self, answer: &Answer) -> Result<String> {
        let text = |value: Option<f64>, decimals: usize| {
            value.map(|v| format!("{v:.decimals$}")).unwrap_or_default()
        };
        let covariance = |i: usize| text(answer.covariance_en_m2.map(|c| c[i]), 6);
        let mut writer = ::csv::Writer::from_writer(Vec::new());
        writer.write_record([
            printable_text(&answer.photo).into_owned(),
            match answer.state {
                State::Fix => "fix".to_owned(),
                State::NoFix => "no_fix".to_owned(),
            },
            text(answer.lat_deg, 8),
            text(answer.lon_deg, 8),
            text(answer.heading_deg, 2),
            text(answer.gsd_m, 6),
            text(answer.radius95_m, 3),
            covariance(0),
            covariance(1),
            covariance(2),
            text(answer.confidence, 6),
            answer.inliers.map(|i| i.to_string()).unwrap_or_default(),
            printable_text(answer.reason.as_deref().unwrap_or_default()).into_owned(),
            text(answer.time_ms.get("total").copied(), 3),
            answer.damaged.to_string(),
            text(answer.check_m, 3),
        ])?;
        let record = writer
            .into_inner()
            .map_err(|error| AnswerError::Csv(error.into_error().into()))?;
        Ok(String::from_utf8_lossy(&record).into_owned())
    }
}
