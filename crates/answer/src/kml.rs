//! Placemarks (OGC KML 2.3) for Google Earth and others: one for each photo, without a geometry if it has no fix.

use crate::answer::Answer;
use crate::antimeridian::cut_line;
use crate::error::Result;
use crate::format::AnswerFormat;
use crate::xml::{Xml, description, leaf, written};

/// Writes [`Answer`]s as KML.
#[derive(Debug, Clone, Copy)]
pub struct Kml;

fn placemark(xml: Xml, answer: &Answer) -> std::io::Result<()> {
    let position = answer.lon_deg.zip(answer.lat_deg);
    xml.create_element("Placemark").write_inner_content(|xml| {
        leaf(xml, "name", &answer.photo)?;
        leaf(xml, "description", &description(answer))?;
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
            let mut ring = outline.unwrap_or_default().to_vec();
            ring.extend(ring.first().copied());
            for line in cut_line(&ring) {
                let points: Vec<String> = line
                    .iter()
                    .map(|[lon, lat]| format!("{lon:.8},{lat:.8}"))
                    .collect();
                xml.create_element("LineString")
                    .write_inner_content(|xml| leaf(xml, "coordinates", &points.join(" ")))?;
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
        Ok(written(|xml| placemark(xml, answer))?)
    }

    fn closing(&self) -> &'static str {
        "</Document>\n</kml>\n"
    }
}
