//! Aligned columns, for reading.

use std::io::Write;
use std::path::Path;

use anyhow::Result;

use super::{AnswerWriter, or_dash};
use crate::answer::{Answer, State};

pub struct Table<'a> {
    out: Box<dyn Write + 'a>,
    answers: usize,
    fixes: usize,
}

impl<'a> Table<'a> {
    pub fn new(out: Box<dyn Write + 'a>) -> Self {
        Self {
            out,
            answers: 0,
            fixes: 0,
        }
    }
}

impl AnswerWriter for Table<'_> {
    fn write(&mut self, answer: &Answer) -> Result<()> {
        if self.answers == 0 {
            writeln!(
                self.out,
                "{:<24} {:>12} {:>13} {:>8} {:>8} {:>8} {:>7}",
                "photo", "latitude", "longitude", "±95% m", "heading", "inliers", "ms"
            )?;
        }
        self.answers += 1;
        let name = Path::new(&answer.photo).file_name().map_or_else(
            || answer.photo.clone(),
            |n| n.to_string_lossy().into_owned(),
        );
        let time = or_dash(answer.time_ms.get("total").copied(), 0);
        match answer.state {
            State::Fix => {
                self.fixes += 1;
                write!(
                    self.out,
                    "{name:<24} {:>12} {:>13} {:>8} {:>8} {:>8} {time:>7}",
                    or_dash(answer.lat_deg, 7),
                    or_dash(answer.lon_deg, 7),
                    or_dash(answer.radius95_m, 1),
                    or_dash(answer.heading_deg, 1),
                    answer.inliers.unwrap_or(0),
                )?;
                if let Some(check) = answer.check_m {
                    write!(self.out, "  {check:.1} m from its metadata")?;
                }
                writeln!(self.out)?;
            }
            State::NoFix => {
                let reason = answer.reason.as_deref().unwrap_or("");
                writeln!(self.out, "{name:<24} no fix: {reason}")?;
            }
        }
        self.out.flush()?;
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        writeln!(
            self.out,
            "{} of {} photos located",
            self.fixes, self.answers
        )?;
        Ok(())
    }
}
