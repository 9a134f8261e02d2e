//! A track as GeoJSON and as GPX.

use grimnet_answer::{GpxTrack, TrackPlace};
use serde_json::{Value, json};

use crate::track_frame::TrackFrame;

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

/// A GPX 1.1 track of the usable positions. Times are left out: the client's clock may have any zero.
pub(crate) fn gpx(id: u64, frames: &[TrackFrame]) -> String {
    let mut track = GpxTrack::named(format!("track {id}"));
    let mut text = track.opening();
    for frame in frames {
        let usable = frame.point.filter(|point| point.state.is_usable());
        let place = usable
            .and_then(|point| point.estimate)
            .map(|at| TrackPlace {
                lon_deg: at.lon_deg,
                lat_deg: at.lat_deg,
                altitude_amsl_m: at.altitude_amsl_m,
                time: None,
            });
        text += &track.point(place);
    }
    text + track.closing()
}
