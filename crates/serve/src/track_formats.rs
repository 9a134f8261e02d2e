//! A track as GeoJSON and as GPX.

use std::sync::Arc;

use grimnet_answer::{GpxTrack, TrackPlace};
use serde_json::json;

use crate::track_frame::TrackFrame;

/// A GeoJSON feature collection (RFC 7946): a line through the usable positions, and a point for each position.
///
/// It is written feature by feature: a track of many frames as one value takes many times the memory of its text.
pub(crate) fn geojson(frames: &[Arc<TrackFrame>]) -> String {
    let mut line = Vec::new();
    let mut points = String::new();
    for frame in frames {
        let Some(point) = frame.point else { continue };
        let Some(estimate) = point.estimate else {
            continue;
        };
        let position = [estimate.lon_deg, estimate.lat_deg];
        if point.state.is_usable() {
            line.push(position);
        }
        let mut properties = json!(point);
        if let Some(properties) = properties.as_object_mut() {
            properties.remove("lat_deg");
            properties.remove("lon_deg");
            properties.insert("role".into(), "position".into());
            properties.insert("number".into(), frame.number.into());
            properties.insert("photo".into(), frame.answer.photo.clone().into());
        }
        let feature = json!({
            "type": "Feature",
            "geometry": { "type": "Point", "coordinates": position },
            "properties": properties,
        });
        points += if points.is_empty() { "" } else { "," };
        points += &feature.to_string();
    }
    let mut text = String::from("{\"type\":\"FeatureCollection\",\"features\":[");
    // A line has two positions at least.
    if line.len() > 1 {
        let whole = json!({
            "type": "Feature",
            "geometry": { "type": "LineString", "coordinates": line },
            "properties": { "role": "line" },
        });
        // The points of the line have features.
        text += &(whole.to_string() + ",");
    }
    text + &points + "]}"
}

/// A GPX 1.1 track of the usable positions. Times are left out: the client's clock may have any zero.
pub(crate) fn gpx(id: u64, frames: &[Arc<TrackFrame>]) -> String {
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
