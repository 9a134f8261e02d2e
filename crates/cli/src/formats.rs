//! Answers as text: a table for people, and the formats that other programs read.

mod csv;
mod geojson;
mod jsonl;
mod kml;
mod stream;
mod table;

use anyhow::Result;

use crate::answer::Answer;
pub use stream::AnswerStream;

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
}

/// The text of one format, in pieces: opening, answers, closing.
trait AnswerFormat {
    /// What stands before the first answer.
    fn opening(&self) -> String {
        String::new()
    }

    /// One answer.
    ///
    /// # Errors
    /// The answer cannot be written in this format.
    fn answer(&mut self, answer: &Answer) -> Result<String>;

    /// What has to follow the last answer for the text to be well-formed; always the same.
    fn closing(&self) -> &'static str {
        ""
    }

    /// What is said at the end of a whole run.
    fn summary(&self) -> String {
        String::new()
    }
}

impl Format {
    fn start(self) -> Box<dyn AnswerFormat> {
        match self {
            Self::Table => Box::<table::Table>::default(),
            Self::Jsonl => Box::new(jsonl::Jsonl),
            Self::Csv => Box::new(csv::Csv),
            Self::Geojson => Box::<geojson::Geojson>::default(),
            Self::Kml => Box::new(kml::Kml),
        }
    }

    /// All answers as one text.
    ///
    /// # Errors
    /// An answer cannot be written in this format.
    pub fn text_of<'a>(self, answers: impl IntoIterator<Item = &'a Answer>) -> Result<String> {
        let mut format = self.start();
        let mut text = format.opening();
        for answer in answers {
            text += &format.answer(answer)?;
        }
        text += format.closing();
        text += &format.summary();
        Ok(text)
    }
}

/// `12.3`, or a dash if there is no value.
fn or_dash(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::answer::State;

    pub(super) fn answers() -> [Answer; 2] {
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
        [fix, Answer::no_fix("c\x1b[2J.jpg", "too few matches")]
    }

    fn written(format: Format) -> String {
        format.text_of(&answers()).unwrap()
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
        let text = written(Format::Kml);
        assert_eq!(text.matches("<Placemark>").count(), 2, "a miss is one too");
        insta::assert_snapshot!(text);
    }
}
