//! A GeoJSON feature collection (RFC 7946): a point for each fix, and the photo's outline.

use geojson::{Feature, Geometry, GeometryValue, JsonObject};

use crate::answer::{Answer, State};
use crate::antimeridian::cut_ring;
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

/// The outline as a polygon, or as two if it crosses the antimeridian; `None` if there is no outline.
fn outline(answer: &Answer) -> Option<GeometryValue> {
    let mut rings = cut_ring(&answer.outline_ring()?);
    for ring in &mut rings {
        ring.extend(ring.first().copied());
    }
    match &rings[..] {
        [] => None,
        [whole] => Some(GeometryValue::new_polygon([whole.clone()])),
        _ => Some(GeometryValue::new_multi_polygon(
            rings.into_iter().map(|ring| [ring]),
        )),
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
        if let Some(outline) = outline(answer) {
            let mut properties = JsonObject::new();
            properties.insert("photo".into(), answer.photo.clone().into());
            properties.insert("role".into(), "outline".into());
            text += &self.line(&feature(Some(outline), properties))?;
        }
        Ok(text)
    }

    fn closing(&self) -> &'static str {
        "\n]}\n"
    }
}
