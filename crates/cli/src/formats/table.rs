//! Aligned columns, for reading.

use std::path::Path;

use grimnet_answer::{
    Answer, AnswerError, AnswerFormat, State, heading_or_dash, or_dash, printable,
};

#[derive(Default)]
pub struct Table {
    answers: usize,
    fixes: usize,
}

impl AnswerFormat for Table {
    fn opening(&self) -> String {
        format!(
            "{:<24} {:>12} {:>13} {:>8} {:>8} {:>8} {:>7}\n",
            "photo", "latitude", "longitude", "±95% m", "heading", "inliers", "ms"
        )
    }

    fn answer(&mut self, answer: &Answer) -> Result<String, AnswerError> {
        self.answers += 1;
        let name = Path::new(&answer.photo).file_name().map_or_else(
            || answer.photo.clone(),
            |n| n.to_string_lossy().into_owned(),
        );
        let name = printable(&name);
        let mut line = format!("{name:<24} ");
        match answer.state {
            State::Fix => {
                self.fixes += 1;
                line += &format!(
                    "{:>12} {:>13} {:>8} {:>8} {:>8} {:>7}",
                    or_dash(answer.lat_deg, 7),
                    or_dash(answer.lon_deg, 7),
                    or_dash(answer.radius95_m, 1),
                    heading_or_dash(answer.heading_deg),
                    answer.inliers.unwrap_or(0),
                    or_dash(answer.time_ms.get("total").copied(), 0),
                );
                if let Some(check) = answer.check_m {
                    line += &format!("  {check:.1} m from its metadata");
                }
            }
            State::NoFix => {
                let reason = answer.reason.as_deref().unwrap_or("");
                line += &format!("no fix: {}", printable(reason));
            }
        }
        line.push('\n');
        Ok(line)
    }

    fn summary(&self) -> String {
        format!("{} of {} photos located\n", self.fixes, self.answers)
    }
}
