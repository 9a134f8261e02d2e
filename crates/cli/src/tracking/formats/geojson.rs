//! A GeoJSON feature collection (RFC 7946): a point for each instant, without a geometry where the position may not be used.

use anyhow::Result;
use geojson::{Feature, Geometry, GeometryValue, JsonObject};

use super::super::line::TrackLine;
use crate::formats::TextFormat;

#[derive(Default)]
pub struct Geojson {
    features: usize,
}

impl TextFormat<TrackLine> for Geojson {
    fn opening(&self) -> String {
        "{\"type\":\"FeatureCollection\",\"features\":[\n".to_owned()
    }

    fn row(&mut self, line: &TrackLine) -> Result<String> {
        let properties = match serde_json::to_value(line)? {
            serde_json::Value::Object(object) => object,
            _ => JsonObject::new(),
        };
        let point = line.lon_lat_deg().map(GeometryValue::new_point);
        let feature = Feature {
            geometry: point.map(Geometry::new),
            properties: Some(properties),
            ..Feature::default()
        };
        let separator = if self.features == 0 { "" } else { ",\n" };
        self.features += 1;
        Ok(separator.to_owned() + &serde_json::to_string(&feature)?)
    }

    fn closing(&self) -> &'static str {
        "\n]}\n"
    }
}
