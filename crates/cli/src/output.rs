//! Answers as text: a table for people, and the forms that other programs read.

mod csv;
mod geojson;
mod jsonl;
mod kml;
mod table;

use std::io::Write;

use anyhow::Result;

use crate::answer::Answer;

/// How answers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Aligned columns, for reading.
    Table,
    /// One JSON object a line.
    Jsonl,
    /// Comma-separated values with a header.
    Csv,
    /// A GeoJSON feature collection: points, and the photos' outlines.
    Geojson,
    /// Placemarks for Google Earth and the like.
    Kml,
}

/// Writes answers one by one, so that a long run shows what it has.
pub trait AnswerWriter {
    /// Writes one answer.
    ///
    /// # Errors
    /// The output cannot be written.
    fn write(&mut self, answer: &Answer) -> Result<()>;

    /// Writes what closes the output.
    ///
    /// # Errors
    /// The output cannot be written.
    fn finish(&mut self) -> Result<()>;
}

impl Format {
    /// A writer of this format.
    pub fn writer<'a>(self, out: Box<dyn Write + 'a>) -> Box<dyn AnswerWriter + 'a> {
        match self {
            Self::Table => Box::new(table::Table::new(out)),
            Self::Jsonl => Box::new(jsonl::Jsonl::new(out)),
            Self::Csv => Box::new(csv::Csv::new(out)),
            Self::Geojson => Box::new(geojson::Geojson::new(out)),
            Self::Kml => Box::new(kml::Kml::new(out)),
        }
    }
}

/// `12.3`, or a dash where there is nothing.
fn or_dash(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::answer::State;

    fn answers() -> [Answer; 2] {
        let fix = Answer {
            photo: "flight/a & b.jpg".into(),
            state: State::Fix,
            lat_deg: Some(24.261_918_45),
            lon_deg: Some(120.720_283_91),
            heading_deg: Some(152.1),
            gsd_m: Some(0.12),
            radius95_m: Some(2.5),
            covariance_en_m2: Some([1.0, 0.1, 1.2]),
            inliers: Some(41),
            time_ms: [("total".to_owned(), 37.0)].into(),
            matches: Some(96),
            outline_lon_lat_deg: Some(vec![
                [120.0, 24.0],
                [121.0, 24.0],
                [121.0, 23.0],
                [120.0, 23.0],
            ]),
            ..Answer::default()
        };
        [fix, Answer::no_fix("c.jpg", "too few matches")]
    }

    fn written(format: Format) -> String {
        let mut out = Vec::new();
        {
            let mut writer = format.writer(Box::new(&mut out));
            for answer in answers() {
                writer.write(&answer).unwrap();
            }
            writer.finish().unwrap();
        }
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn table() {
        insta::assert_snapshot!(written(Format::Table));
    }

    #[test]
    fn jsonl() {
        insta::assert_snapshot!(written(Format::Jsonl));
    }

    #[test]
    fn csv() {
        insta::assert_snapshot!(written(Format::Csv));
    }

    #[test]
    fn geojson() {
        let text = written(Format::Geojson);
        let collection: ::geojson::FeatureCollection = text.parse().unwrap();
        assert_eq!(
            collection.features.len(),
            3,
            "a point and an outline for the fix, a feature for the miss"
        );
        insta::assert_snapshot!(text);
    }

    #[test]
    fn kml() {
        insta::assert_snapshot!(written(Format::Kml));
    }
}
