//! A GeoJSON feature collection (RFC 7946): a point for each fix, and the photo's outline.

use std::io::Write;

use anyhow::Result;
use geojson::{Feature, FeatureCollection, Geometry, GeometryValue, JsonObject};

use super::AnswerWriter;
use crate::answer::{Answer, State};

pub struct Geojson<'a> {
    out: Box<dyn Write + 'a>,
    features: Vec<Feature>,
}

impl<'a> Geojson<'a> {
    pub fn new(out: Box<dyn Write + 'a>) -> Self {
        Self {
            out,
            features: Vec::new(),
        }
    }
}

fn feature(geometry: Option<GeometryValue>, properties: JsonObject) -> Feature {
    Feature {
        geometry: geometry.map(Geometry::new),
        properties: Some(properties),
        ..Feature::default()
    }
}

impl AnswerWriter for Geojson<'_> {
    fn write(&mut self, answer: &Answer) -> Result<()> {
        let mut properties = match serde_json::to_value(answer)? {
            serde_json::Value::Object(object) => object,
            _ => JsonObject::new(),
        };
        properties.remove("outline_lon_lat_deg");
        let point = answer
            .lon_deg
            .zip(answer.lat_deg)
            .filter(|_| answer.state == State::Fix)
            .map(|(lon, lat)| GeometryValue::new_point([lon, lat]));
        self.features.push(feature(point, properties));
        if let Some(outline) = &answer.outline_lon_lat_deg {
            let ring = outline.iter().chain(outline.first()).copied();
            let mut properties = JsonObject::new();
            properties.insert("photo".into(), answer.photo.clone().into());
            properties.insert("role".into(), "outline".into());
            let polygon = GeometryValue::new_polygon([ring.collect::<Vec<_>>()]);
            self.features.push(feature(Some(polygon), properties));
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        let collection = FeatureCollection {
            features: std::mem::take(&mut self.features),
            bbox: None,
            foreign_members: None,
        };
        serde_json::to_writer(&mut self.out, &collection)?;
        writeln!(self.out)?;
        self.out.flush()?;
        Ok(())
    }
}
