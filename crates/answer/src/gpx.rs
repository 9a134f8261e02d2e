//! Waypoints (GPX 1.1, <https://www.topografix.com/GPX/1/1/>): one for each photo with a fix, for which alone there is a position.

use crate::answer::Answer;
use crate::error::Result;
use crate::format::AnswerFormat;
use crate::xml::{description, leaf, written};

/// Writes [`Answer`]s as GPX.
#[derive(Debug, Clone, Copy)]
pub struct Gpx;

impl AnswerFormat for Gpx {
    fn opening(&self) -> String {
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <gpx version=\"1.1\" creator=\"grimnet\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n"
            .to_owned()
    }

    fn answer(&mut self, answer: &Answer) -> Result<String> {
        let Some((lon_deg, lat_deg)) = answer.lon_deg.zip(answer.lat_deg) else {
            return Ok(String::new());
        };
        let (lat, lon) = (format!("{lat_deg:.8}"), format!("{lon_deg:.8}"));
        Ok(written(|xml| {
            xml.create_element("wpt")
                .with_attributes([("lat", lat.as_str()), ("lon", lon.as_str())])
                .write_inner_content(|xml| {
                    leaf(xml, "name", &answer.photo)?;
                    leaf(xml, "desc", &description(answer))
                })?;
            Ok(())
        })?)
    }

    fn closing(&self) -> &'static str {
        "</gpx>\n"
    }
}
