//! A track as GeoJSON and as GPX.

use std::sync::Arc;

use grimnet_answer::{GpxTrack, TrackPlace, track_lines};
use grimnet_track::Estimate;
use serde_json::json;

use crate::track_frame::TrackFrame;

/// The position of a frame, if it may be used.
fn usable(frame: &TrackFrame) -> Option<Estimate> {
    let point = frame.point.filter(|point| point.state.is_usable())?;
    point.estimate
}

/// A GeoJSON feature collection (RFC 7946): lines through the usable positions, which end at every frame without one, and a point for each
/// position.
///
/// It is written feature by feature: a track of many frames as one value takes many times the memory of its text.
pub(crate) fn geojson(frames: &[Arc<TrackFrame>]) -> String {
    let mut points = String::new();
    for frame in frames {
        let Some(point) = frame.point else { continue };
        let Some(estimate) = point.estimate else {
            continue;
        };
        let position = [estimate.lon_deg, estimate.lat_deg];
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
    let positions = frames
        .iter()
        .map(|frame| usable(frame).map(|at| [at.lon_deg, at.lat_deg]));
    let lines = track_lines(&positions.collect::<Vec<_>>());
    if !lines.is_empty() {
        let lines = json!({
            "type": "Feature",
            "geometry": { "type": "MultiLineString", "coordinates": lines },
            "properties": { "role": "line" },
        });
        // The points of the lines have features.
        text += &(lines.to_string() + ",");
    }
    text + &points + "]}"
}

/// A GPX 1.1 track of the usable positions. Times are left out: the client's clock may have any zero.
pub(crate) fn gpx(id: u64, frames: &[Arc<TrackFrame>]) -> String {
    let mut track = GpxTrack::named(format!("track {id}"));
    let mut text = track.opening();
    for frame in frames {
        let place = usable(frame).map(|at| TrackPlace {
            lon_deg: at.lon_deg,
            lat_deg: at.lat_deg,
            altitude_amsl_m: at.altitude_amsl_m,
            time: None,
        });
        text += &track.point(place);
    }
    text + track.closing()
}

#[cfg(test)]
mod tests {
    use grimnet_answer::Answer;
    use grimnet_flight::Searched;
    use grimnet_track::{PositionOf, Source, TrackPoint, TrackState};
    use serde_json::Value;

    use super::*;

    fn frame(number: u64, state: TrackState, lon_deg: f64) -> Arc<TrackFrame> {
        let time_s = number as f64;
        let estimate = Estimate {
            lat_deg: 24.0,
            lon_deg,
            altitude_amsl_m: None,
            height_agl_m: None,
            velocity_east_m_s: 10.0,
            velocity_north_m_s: 0.0,
            velocity_sigma_m_s: 1.0,
            heading_deg: None,
            heading_sigma_deg: None,
            covariance_en_m2: [1.0, 0.0, 1.0],
            radius95_m: 2.5,
            age_of_last_fix_s: Some(0.0),
            distance_since_fix_m: 0.0,
            test_ratio: 0.1,
            weight: 1.0,
            source: Source::Fix,
            position_of: PositionOf::Aircraft,
        };
        let point = TrackPoint {
            time_s,
            state,
            estimate: Some(estimate),
        };
        let answer = Answer::no_fix("a.jpg", "too few matches");
        let searched = Searched::WholeMap;
        Arc::new(TrackFrame::new(
            number,
            time_s,
            &searched,
            Some(point),
            answer,
        ))
    }

    /// A frame that came too late for the track.
    fn too_old(number: u64) -> Arc<TrackFrame> {
        let mut frame = TrackFrame::clone(&frame(number, TrackState::Tracking, 0.0));
        frame.point = None;
        Arc::new(frame)
    }

    /// The coordinates of the lines, and the number of points.
    fn shapes(frames: &[Arc<TrackFrame>]) -> (Option<Value>, usize) {
        let collection: Value = serde_json::from_str(&geojson(frames)).unwrap();
        let features = collection["features"].as_array().unwrap();
        let of = |role: &'static str| {
            let features = features.iter();
            features.filter(move |feature| feature["properties"]["role"] == role)
        };
        let lines = of("line").next().map(|line| {
            assert_eq!(line["geometry"]["type"], "MultiLineString");
            line["geometry"]["coordinates"].clone()
        });
        (lines, of("position").count())
    }

    #[test]
    fn lines_end_where_the_aircraft_was_lost() {
        use TrackState::{Coasting, Lost, Tracking};
        let mut frames = vec![
            frame(1, Tracking, 120.0),
            frame(2, Coasting, 120.1),
            frame(3, Lost, 120.2),
            frame(4, Tracking, 121.0),
            too_old(5),
            frame(6, Tracking, 179.5),
            frame(7, Tracking, -179.5),
        ];
        let expected = json!([
            [[120.0, 24.0], [120.1, 24.0]],
            [[179.5, 24.0], [180.0, 24.0]],
            [[-180.0, 24.0], [-179.5, 24.0]],
        ]);
        assert_eq!(shapes(&frames), (Some(expected), 6));
        assert_eq!(gpx(1, &frames).matches("<trkseg>").count(), 3);
        // No line has two points.
        frames.truncate(1);
        assert_eq!(shapes(&frames), (None, 1));
    }
}
