//! A GeoJSON feature collection (RFC 7946): a point for each fix, and the photo's outline.

use geojson::{Feature, Geometry, GeometryValue, JsonObject};

use crate::answer::{Answer, State};
use crate::error::Result;
use crate::format::AnswerFormat;

/// Writes [`Answer`]s as GeoJSON.
#[derive(Debug, Clone, Default)]
pub struct Geojson {
    features: usize,
}

fn feature(geometry: Option<GeometryValue>, properties: JsonObject) -> Feature {
    Feature {
        geometry: geometry.map(Geometry::new),
        properties: Some(properties),
        ..Feature::default()
    }
}

impl Geojson {
    /// A feature as text, on a line of its own.
    fn line(&mut self, feature: &Feature) -> Result<String> {
        let separator = if self.features == 0 { "" } else { ",\n" };
        self.features += 1;
        Ok(separator.to_owned() + &serde_json::to_string(feature)?)
    }
}

impl AnswerFormat for Geojson {
    fn opening(&self) -> String {
        "{\"type\":\"FeatureCollection\",\"features\":[\n".to_owned()
    }

    fn answer(&mut self, answer: &Answer) -> Result<String> {
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
        let mut text = self.line(&feature(point, properties))?;
        if let Some(outline) = &answer.outline_lon_lat_deg {
            let ring = outline.iter().chain(outline.first()).copied();
            let mut properties = JsonObject::new();
            properties.insert("photo".into(), answer.photo.clone().into());
            properties.insert("role".into(), "outline".into());
            let polygon = GeometryValue::new_polygon([ring.collect::<Vec<_>>()]);
            text += &self.line(&feature(Some(polygon), properties))?;
        }
        Ok(text)
    }

    fn closing(&self) -> &'static str {
        "\n]}\n"
    }
}
