//! Placemarks (OGC KML 2.3) for Google Earth and the like.

use std::io::Write;

use anyhow::Result;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};

use super::{AnswerWriter, or_dash};
use crate::answer::Answer;

pub struct Kml<'a> {
    writer: Writer<Box<dyn Write + 'a>>,
    answers: Vec<Answer>,
}

impl<'a> Kml<'a> {
    pub fn new(out: Box<dyn Write + 'a>) -> Self {
        Self {
            writer: Writer::new_with_indent(out, b' ', 1),
            answers: Vec::new(),
        }
    }
}

type Xml<'w, 'a> = &'w mut Writer<Box<dyn Write + 'a>>;

fn leaf(xml: Xml, name: &str, text: &str) -> std::io::Result<()> {
    xml.create_element(name)
        .write_text_content(BytesText::new(text))?;
    Ok(())
}

fn placemark(xml: Xml, answer: &Answer) -> std::io::Result<()> {
    let Some((lon, lat)) = answer.lon_deg.zip(answer.lat_deg) else {
        return Ok(());
    };
    xml.create_element("Placemark").write_inner_content(|xml| {
        leaf(xml, "name", &answer.photo)?;
        let description = format!(
            "heading {} degrees, 95 % radius {} m, {} inliers",
            or_dash(answer.heading_deg, 1),
            or_dash(answer.radius95_m, 1),
            answer.inliers.unwrap_or(0)
        );
        leaf(xml, "description", &description)?;
        xml.create_element("MultiGeometry")
            .write_inner_content(|xml| {
                xml.create_element("Point").write_inner_content(|xml| {
                    leaf(xml, "coordinates", &format!("{lon:.8},{lat:.8}"))
                })?;
                if let Some(outline) = &answer.outline_lon_lat_deg {
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
    })?;
    Ok(())
}

impl AnswerWriter for Kml<'_> {
    fn write(&mut self, answer: &Answer) -> Result<()> {
        self.answers.push(answer.clone());
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        let answers = std::mem::take(&mut self.answers);
        self.writer
            .write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        self.writer
            .create_element("kml")
            .with_attribute(("xmlns", "http://www.opengis.net/kml/2.2"))
            .write_inner_content(|xml| {
                xml.create_element("Document").write_inner_content(|xml| {
                    leaf(xml, "name", "grimnet")?;
                    answers.iter().try_for_each(|answer| placemark(xml, answer))
                })?;
                Ok(())
            })?;
        let out = self.writer.get_mut();
        writeln!(out)?;
        out.flush()?;
        Ok(())
    }
}
