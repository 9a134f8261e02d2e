//! The lines of a recorded flight after smoothing.

use anyhow::Result;
use grimnet_track::{Input, SmoothedPoint, Source, TrackOptions, TrackState, smooth};

use super::frame_time::Epoch;
use super::line::{FrameResult, TimeText, TrackLine};
use grimnet_answer::rounded;

/// A line for each instant that was smoothed: each fix that turned out to be right, each velocity and motion. What smoothing does not
/// tell (heading, height, photo) is taken from the frame of that time.
///
/// # Errors
/// An option of the filter is out of range.
pub fn smoothed_lines(
    frames: &[(f64, TrackLine)],
    inputs: &[Input],
    epoch: Epoch,
    options: &TrackOptions,
) -> Result<Vec<TrackLine>> {
    let points = smooth(inputs, options)?;
    let mut last_fix_s: Option<f64> = None;
    let mut piece = 0;
    let mut lines = Vec::with_capacity(points.len());
    for point in &points {
        if point.piece != piece {
            (piece, last_fix_s) = (point.piece, None);
        }
        let frame = frames
            .iter()
            .find(|(time_s, _)| *time_s == point.time_s)
            .map(|(_, line)| line);
        let is_fix = frame
            .and_then(|line| line.note.as_ref())
            .is_some_and(|note| note.frame == FrameResult::Fix);
        if is_fix {
            last_fix_s = Some(point.time_s);
        }
        lines.push(line(point, frame, last_fix_s, epoch, options));
    }
    Ok(lines)
}

fn line(
    point: &SmoothedPoint,
    frame: Option<&TrackLine>,
    last_fix_s: Option<f64>,
    epoch: Epoch,
    options: &TrackOptions,
) -> TrackLine {
    let age_s = last_fix_s.map(|fix_s| point.time_s - fix_s);
    TrackLine {
        time: TimeText::of(point.time_s, epoch),
        state: if age_s.is_some_and(|age_s| age_s <= options.coasting_after_s) {
            TrackState::Tracking
        } else {
            TrackState::Coasting
        },
        lat_deg: Some(rounded(point.lat_deg, 8)),
        lon_deg: Some(rounded(point.lon_deg, 8)),
        heading_deg: frame.and_then(|line| line.heading_deg),
        radius95_m: Some(rounded(point.radius95_m, 3)),
        covariance_en_m2: Some(point.covariance_en_m2.map(|v| rounded(v, 6))),
        age_of_last_fix_s: age_s.map(|age_s| rounded(age_s, 3)),
        velocity_east_m_s: Some(rounded(point.velocity_east_m_s, 3)),
        velocity_north_m_s: Some(rounded(point.velocity_north_m_s, 3)),
        height_agl_m: frame.and_then(|line| line.height_agl_m),
        altitude_amsl_m: frame.and_then(|line| line.altitude_amsl_m),
        position_of: frame.and_then(|line| line.position_of),
        source: (age_s == Some(0.0)).then_some(Source::Fix),
        note: frame.and_then(|line| line.note.clone()),
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::LonLat;
    use grimnet_track::PositionFix;

    use super::super::line::FrameNote;
    use super::*;

    #[test]
    fn every_right_fix_has_a_line_with_its_photo_and_a_smaller_radius() {
        let options = TrackOptions::default();
        let mut frames = Vec::new();
        let mut inputs = Vec::new();
        for number in 0..40 {
            let time_s = 0.5 * f64::from(number);
            // One fix is of another place.
            let aside_deg = if number == 20 { 0.01 } else { 0.0 };
            inputs.push(Input::Fix(PositionFix {
                time_s,
                lonlat: LonLat::new(120.7 + aside_deg, 24.2 + time_s * 5e-5),
                covariance_en_m2: [4.0, 0.0, 4.0],
                map_error_m: 0.5,
                heading_deg: Some(0.0),
                gsd_m: 0.05,
                confidence: 0.99,
            }));
            let note = FrameNote {
                photo: format!("{number}.jpg"),
                frame: FrameResult::Fix,
                reason: None,
                time_ms: 1.0,
            };
            frames.push((
                time_s,
                TrackLine::new(time_s, Epoch::Start, None, Some(note)),
            ));
        }
        let lines = smoothed_lines(&frames, &inputs, Epoch::Start, &options).unwrap();
        assert_eq!(lines.len(), 39, "the wrong fix is left out");
        assert!(lines.iter().all(|line| line.photo() != "20.jpg"));
        assert_eq!(lines[10].photo(), "10.jpg");
        assert!(lines[15].radius95_m.unwrap() < 4.0, "{:?}", lines[15]);
    }
}
