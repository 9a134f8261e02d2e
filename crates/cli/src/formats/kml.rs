//! Placemarks (OGC KML 2.3) for Google Earth and others: one for each photo, without a geometry if it has no fix.

use anyhow::Result;
use quick_xml::Writer;
use quick_xml::events::BytesText;

use super::{AnswerFormat, or_dash};
use crate::answer::Answer;
use crate::terminal::printable_text;

pub struct Kml;

type Xml<'w> = &'w mut Writer<Vec<u8>>;

/// An element that holds text. XML 1.0 cannot hold control characters, escaped or not.
fn leaf(xml: Xml, name: &str, text: &str) -> std::io::Result<()> {
    xml.create_element(name)
        .write_text_content(BytesText::new(&printable_text(text)))?;
    Ok(())
}

fn placemark(xml: Xml, answer: &Answer) -> std::io::Result<()> {
    let position = answer.lon_deg.zip(answer.lat_deg);
    let description = match (position, &answer.reason) {
        (Some(_), _) => format!(
            "heading {} degrees, 95 % radius {} m, {} inliers",
            or_dash(answer.heading_deg, 1),
            or_dash(answer.radius95_m, 1),
            answer.inliers.unwrap_or(0)
        ),
        (None, Some(reason)) => format!("no fix: {reason}"),
        (None, None) => "no fix".to_owned(),
    };
    xml.create_element("Placemark").write_inner_content(|xml| {
        leaf(xml, "name", &answer.photo)?;
        leaf(xml, "description", &description)?;
        if let Some((lon, lat)) = position {
            geometry(xml, lon, lat, answer.outline_lon_lat_deg.as_deref())?;
        }
        Ok(())
    })?;
    Ok(())
}

fn geometry(xml: Xml, lon: f64, lat: f64, outline: Option<&[[f64; 2]]>) -> std::io::Result<()> {
    xml.create_element("MultiGeometry")
        .write_inner_content(|xml| {
            xml.create_element("Point").write_inner_content(|xml| {
                leaf(xml, "coordinates", &format!("{lon:.8},{lat:.8}"))
            })?;
            if let Some(outline) = outline {
                let ring: Vec<String> = outline
                    .iter()
                    .chain(outline.first())
                    .map(|[lon, lat]| format!("{lon:.8},{lat:.8}"))
                    .collect();
                xml.create_element("LineString")
                    .write_inner_content(|xml| leaf(xml, "coordinates", &ring.join(" ")))?;
            }
            Ok(())
        })?;
    Ok(())
}

impl AnswerFormat for Kml {
    fn opening(&self) -> String {
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <kml xmlns=\"http://www.opengis.net/kml/2.2\">\n\
         <Document>\n\
         <name>grimnet</name>\n"
            .to_owned()
    }

    fn answer(&mut self, answer: &Answer) -> Result<String> {
        let mut xml = Writer::new_with_indent(Vec::new(), b' ', 1);
        placemark(&mut xml, answer)?;
        Ok(String::from_utf8(xml.into_inner())? + "\n")
    }

    fn closing(&self) -> &'static str {
        "</Document>\n</kml>\n"
    }
}
