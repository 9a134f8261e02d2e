//! Answers as text: a table for people, and the formats that other programs read.

mod answer_output;
mod row_output;
mod stream;
mod table;
mod text_target;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::ValueEnum;
use grimnet_answer::{Answer, AnswerFormat, Csv, Geojson, Gpx, Jsonl, Kml, printable};

pub use answer_output::AnswerOutput;
pub use grimnet_answer::or_dash;
pub use row_output::RowOutput;
pub use stream::{AnswerStream, TextFormat, TextStream};
pub use text_target::TextTarget;

/// What is said where a database was asked for on standard output.
pub const NOT_TEXT: &str = "a GeoPackage is a file; give its name with -o FILE.gpkg";

/// An error that ended a run, with where its rows so far are: in the `partial` file, if that holds any. `so_far` is what the message says
/// before its name.
pub fn stopped(error: anyhow::Error, so_far: &str, partial: Option<PathBuf>) -> anyhow::Error {
    let holds_rows = |path: &PathBuf| path.metadata().is_ok_and(|found| found.len() > 0);
    match partial.filter(holds_rows) {
        Some(path) => error.context(format!("stopped; {so_far} {}", path.display())),
        None => error,
    }
}

/// How answers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Aligned columns, for reading
    Table,
    /// One JSON object per line
    Jsonl,
    /// Comma-separated values with a header
    Csv,
    /// A GeoJSON feature collection (RFC 7946): a point and an outline for each fix
    Geojson,
    /// Placemarks (KML 2.3), for Google Earth and others
    Kml,
    /// Waypoints (GPX 1.1), for navigation programs: photos with a fix alone
    Gpx,
    /// A GeoPackage (OGC), for QGIS: points, outlines and 95 % ellipses as layers; a file, written when the run ends
    #[cfg(feature = "sqlite")]
    Gpkg,
}

/// Warns if a file's ending is that of no format, or of another one than the file gets.
pub fn warn_of_ending<F: ValueEnum + PartialEq>(
    file: &Path,
    by_ending: Option<F>,
    asked: Option<F>,
) {
    let file_text = file.display().to_string();
    let file_text = printable(&file_text);
    let name = |format: &F| {
        let value = format.to_possible_value();
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    };
    match (by_ending, asked) {
        (None, None) if file.extension().is_some() => {
            tracing::warn!(
                "{file_text}: no format has this ending, so that JSON lines are written; --format chooses another one"
            );
        }
        (Some(ending), Some(asked)) if ending != asked => {
            tracing::warn!(
                "{file_text}: --format {} is written into a file with the ending of {}",
                name(&asked),
                name(&ending)
            );
        }
        _ => {}
    }
}

impl Format {
    /// The format as text; `None` for one that is not text.
    fn start(self) -> Option<Box<dyn AnswerFormat>> {
        Some(match self {
            Self::Table => Box::<table::Table>::default(),
            Self::Jsonl => Box::new(Jsonl),
            Self::Csv => Box::new(Csv),
            Self::Geojson => Box::<Geojson>::default(),
            Self::Kml => Box::new(Kml),
            Self::Gpx => Box::new(Gpx),
            #[cfg(feature = "sqlite")]
            Self::Gpkg => return None,
        })
    }

    /// The format that the ending of a file's name tells.
    pub fn of_name(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_lowercase().as_str() {
            "txt" => Some(Self::Table),
            "jsonl" | "ndjson" | "json" => Some(Self::Jsonl),
            "csv" => Some(Self::Csv),
            "geojson" => Some(Self::Geojson),
            "kml" => Some(Self::Kml),
            "gpx" => Some(Self::Gpx),
            #[cfg(feature = "sqlite")]
            "gpkg" => Some(Self::Gpkg),
            _ => None,
        }
    }

    /// All answers as one text.
    ///
    /// # Errors
    /// An answer cannot be written in this format.
    pub fn text_of<'a>(self, answers: impl IntoIterator<Item = &'a Answer>) -> Result<String> {
        let mut format = self.start().context("a GeoPackage is not text")?;
        Ok(grimnet_answer::text_of(format.as_mut(), answers)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_answer::State;

    pub(super) fn answers() -> [Answer; 2] {
        let fix = Answer {
            photo: "flight/a & b.jpg".into(),
            state: State::Fix,
            lat_deg: Some(24.261_918_45),
            lon_deg: Some(120.720_283_91),
            heading_deg: Some(152.1),
            radius95_m: Some(2.5),
            inliers: Some(41),
            time_ms: [("total".to_owned(), 37.0)].into(),
            ..Answer::default()
        };
        [fix, Answer::no_fix("c\x1b[2J.jpg", "too few matches")]
    }

    #[test]
    fn the_ending_of_a_name_tells_the_format() {
        let of = |name: &str| Format::of_name(Path::new(name));
        for (name, format) in [
            ("a.geojson", Format::Geojson),
            ("a.GeoJSON", Format::Geojson),
            ("a.csv", Format::Csv),
            ("a.kml", Format::Kml),
            ("a.gpx", Format::Gpx),
            ("a.txt", Format::Table),
            ("a.json", Format::Jsonl),
            ("a.jsonl", Format::Jsonl),
        ] {
            assert_eq!(of(name), Some(format), "{name}");
        }
        for name in ["fixes", "a.out", "csv", "/dev/stdout"] {
            assert_eq!(of(name), None, "{name}");
        }
    }

    #[test]
    fn table() {
        insta::assert_snapshot!(Format::Table.text_of(&answers()).unwrap());
    }
}
