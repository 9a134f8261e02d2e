//! A track as GeoJSON and as GPX.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::track_store::TrackFrame;

/// A GeoJSON feature collection (RFC 7946): a line through the usable positions, and a point for each position.
pub(crate) fn geojson(frames: &[TrackFrame]) -> Value {
    let mut line = Vec::new();
    let mut features = Vec::new();
    for frame in frames {
        let Some(point) = frame.point else { continue };
        let Some(estimate) = point.estimate else {
            continue;
        };
        let position = json!([estimate.lon_deg, estimate.lat_deg]);
        if point.state.is_usable() {
            line.push(position.clone());
        }
        let mut properties = json!(point);
        if let Some(properties) = properties.as_object_mut() {
            properties.remove("lat_deg");
            properties.remove("lon_deg");
            properties.insert("role".into(), "position".into());
            properties.insert("number".into(), frame.number.into());
            properties.insert("photo".into(), frame.answer.photo.clone().into());
        }
        features.push(json!({
            "type": "Feature",
            "geometry": { "type": "Point", "coordinates": position },
            "properties": properties,
        }));
    }
    // A line has two positions at least.
    if line.len() > 1 {
        let whole = json!({
            "type": "Feature",
            "geometry": { "type": "LineString", "coordinates": line },
            "properties": { "role": "line" },
        });
        features.insert(0, whole);
    }
    json!({ "type": "FeatureCollection", "features": features })
}

/// A GPX 1.1 track of the usable positions; where they end or begin a segment does. Times are left out: the client's clock may have
/// any zero.
pub(crate) fn gpx(id: u64, frames: &[TrackFrame]) -> String {
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <gpx version=\"1.1\" creator=\"grimnet\" xmlns=\"http://www.topografix.com/GPX/1/1\">\n\
         <trk>\n <name>track {id}</name>\n <trkseg>\n"
    );
    let mut in_segment = false;
    for frame in frames {
        let usable = frame
            .point
            .filter(|point| point.state.is_usable())
            .and_then(|point| point.estimate);
        match usable {
            Some(at) => {
                in_segment = true;
                let elevation = at
                    .altitude_amsl_m
                    .map_or(String::new(), |amsl_m| format!("<ele>{amsl_m:.2}</ele>"));
                // Writing to a string does not fail.
                let _ = writeln!(
                    text,
                    "  <trkpt lat=\"{:.8}\" lon=\"{:.8}\">{elevation}</trkpt>",
                    at.lat_deg, at.lon_deg
                );
            }
            None if in_segment => {
                in_segment = false;
                text.push_str(" </trkseg>\n <trkseg>\n");
            }
            None => {}
        }
    }
    text + " </trkseg>\n</trk>\n</gpx>\n"
}
