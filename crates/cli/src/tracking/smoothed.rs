//! The lines of a recorded flight after smoothing.

use anyhow::Result;
use grimnet_track::{Input, PositionOf, SmoothedPoint, Source, TrackOptions, TrackState, smooth};

use super::frame_time::Epoch;
use super::line::{TimeText, TrackLine};
use grimnet_answer::rounded;

/// A line for each instant that was smoothed: each fix that turned out to be right, each velocity and motion. What smoothing does not
/// tell (heading, height, photo) is taken from the frame of that time. Where the track is interrupted, there is a line without a position.
/// Each with its time, seconds.
///
/// # Errors
/// An option of the filter is out of range.
pub fn smoothed_lines(
    frames: &[(f64, TrackLine)],
    inputs: &[Input],
    epoch: Epoch,
    options: &TrackOptions,
) -> Result<Vec<(f64, TrackLine)>> {
    let points = smooth(inputs, options)?;
    let mut last_fix_s: Option<f64> = None;
    // Before the first frame whose position was known, it is taken to be that of this frame.
    let mut position_of = frames.iter().find_map(|(_, line)| line.position_of);
    let mut before: Option<&SmoothedPoint> = None;
    let mut lines = Vec::with_capacity(points.len());
    for point in &points {
        if let Some(before) = before.replace(point) {
            lines.extend(interruption(before, point, frames, epoch, options));
            if point.piece != before.piece {
                last_fix_s = None;
            }
        }
        let frame = frames
            .iter()
            .find(|(time_s, _)| *time_s == point.time_s)
            .map(|(_, line)| line);
        if point.is_fix {
            last_fix_s = Some(point.time_s);
        }
        position_of = frame.and_then(|line| line.position_of).or(position_of);
        let of = (last_fix_s, position_of);
        lines.push((point.time_s, line(point, frame, of, epoch, options)));
    }
    Ok(lines)
}

/// A line without a position between two points that are not to be joined: those of two pieces, and those with a frame between whose
/// position was not known. Points no further apart than the age at which a fix still counts are joined over such a frame.
fn interruption(
    before: &SmoothedPoint,
    after: &SmoothedPoint,
    frames: &[(f64, TrackLine)],
    epoch: Epoch,
    options: &TrackOptions,
) -> Option<(f64, TrackLine)> {
    let is_one_piece = before.piece == after.piece;
    if is_one_piece && after.time_s - before.time_s <= options.coasting_after_s {
        return None;
    }
    let is_between = |time_s: f64| before.time_s < time_s && time_s < after.time_s;
    let unknown = frames
        .iter()
        .find(|(time_s, line)| is_between(*time_s) && line.lat_deg.is_none());
    match unknown {
        Some(frame) => Some(frame.clone()),
        None if is_one_piece => None,
        None => {
            let time_s = 0.5 * (before.time_s + after.time_s);
            let line = TrackLine {
                state: TrackState::Ambiguous,
                ..TrackLine::new(time_s, epoch, None, None)
            };
            Some((time_s, line))
        }
    }
}

fn line(
    point: &SmoothedPoint,
    frame: Option<&TrackLine>,
    (last_fix_s, position_of): (Option<f64>, Option<PositionOf>),
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
        position_of,
        source: (age_s == Some(0.0)).then_some(Source::Fix),
        note: frame.and_then(|line| line.note.clone()),
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::LonLat;
    use grimnet_track::{PositionFix, Velocity};

    use super::super::formats::TrackFormat;
    use super::super::line::{FrameNote, FrameResult};
    use super::*;

    /// Two frames a second.
    const FRAMES_PER_S: f64 = 2.0;

    /// A flight to the north, so many degrees east of its line at each frame, or without a fix there; nothing is known live.
    fn flight(east_deg: &[Option<f64>]) -> (Vec<(f64, TrackLine)>, Vec<Input>) {
        let mut frames = Vec::new();
        let mut inputs = Vec::new();
        for (number, east_deg) in east_deg.iter().enumerate() {
            let time_s = number as f64 / FRAMES_PER_S;
            inputs.extend(east_deg.map(|east_deg| {
                Input::Fix(PositionFix {
                    time_s,
                    lonlat: LonLat::new(120.7 + east_deg, 24.2 + time_s * 5e-5),
                    covariance_en_m2: [4.0, 0.0, 4.0],
                    map_error_m: 0.5,
                    heading_deg: Some(0.0),
                    gsd_m: 0.05,
                    confidence: 0.99,
                })
            }));
            let note = FrameNote {
                photo: format!("{number}.jpg"),
                frame: if east_deg.is_some() {
                    FrameResult::Fix
                } else {
                    FrameResult::NoFix
                },
                reason: None,
                time_ms: 1.0,
            };
            let line = TrackLine::new(time_s, Epoch::Start, None, Some(note));
            frames.push((time_s, line));
        }
        (frames, inputs)
    }

    fn smoothed(frames: &[(f64, TrackLine)], inputs: &[Input]) -> Vec<TrackLine> {
        let lines = smoothed_lines(frames, inputs, Epoch::Start, &TrackOptions::default()).unwrap();
        lines.into_iter().map(|(_, line)| line).collect()
    }

    /// The segments of a GPX file and the lines of a KML file.
    fn parts(lines: &[TrackLine]) -> [usize; 2] {
        [
            (TrackFormat::Gpx, "<trkseg>"),
            (TrackFormat::Kml, "<LineString>"),
        ]
        .map(|(format, part)| format.text_of(lines).unwrap().matches(part).count())
    }

    #[test]
    fn pieces_are_not_joined() {
        // What was followed first is another place a kilometre away.
        let east_deg: Vec<_> = [0.01; 40].into_iter().chain([0.0; 80]).map(Some).collect();
        let (frames, inputs) = flight(&east_deg);
        let pieces = smooth(&inputs, &TrackOptions::default()).unwrap();
        assert_eq!(pieces.last().unwrap().piece, 1);
        // No frame is between the two, or one is that was not known.
        for is_lost in [false, true] {
            let mut inputs = inputs.clone();
            if is_lost {
                inputs.remove(40);
            }
            let lines = smoothed(&frames, &inputs);
            assert_eq!(parts(&lines), [2, 2]);
            let unknown: Vec<_> = lines.iter().filter(|l| l.lat_deg.is_none()).collect();
            assert_eq!(unknown.len(), 1);
            let photo = if is_lost { "40.jpg" } else { "" };
            assert_eq!(unknown[0].photo(), photo);
            assert!(!unknown[0].state.is_usable());
        }
    }

    #[test]
    fn a_part_ends_where_frames_are_not_known() {
        let gap = |frames: usize| {
            let mut east_deg = vec![Some(0.0); 80];
            east_deg[30..30 + frames].fill(None);
            flight(&east_deg)
        };
        let (mut frames, inputs) = gap(6);
        let pieces = smooth(&inputs, &TrackOptions::default()).unwrap();
        assert_eq!(pieces.last().unwrap().piece, 0);
        let lines = smoothed(&frames, &inputs);
        assert_eq!(parts(&lines), [2, 2]);
        assert_eq!(lines[30], frames[30].1, "the frame as it was live");
        // A short gap is none.
        let (short, inputs_of_short) = gap(2);
        assert_eq!(parts(&smoothed(&short, &inputs_of_short)), [1, 1]);
        // Nor is one in which the live track went on.
        for (_, line) in &mut frames[30..36] {
            (line.lon_deg, line.lat_deg) = (Some(120.7), Some(24.2));
        }
        assert_eq!(parts(&smoothed(&frames, &inputs)), [1, 1]);
    }

    #[test]
    fn every_position_says_of_which_point_it_is() {
        let (mut frames, inputs) = flight(&[Some(0.0); 40]);
        for (number, (_, line)) in frames.iter_mut().enumerate() {
            line.position_of = match number {
                10..20 => Some(PositionOf::ImageCentre),
                25.. => Some(PositionOf::Aircraft),
                _ => None,
            };
        }
        let of: Vec<_> = smoothed(&frames, &inputs)
            .iter()
            .map(|line| line.position_of)
            .collect();
        assert!(
            of[..25]
                .iter()
                .all(|of| *of == Some(PositionOf::ImageCentre))
        );
        assert!(of[25..].iter().all(|of| *of == Some(PositionOf::Aircraft)));
    }

    #[test]
    fn every_right_fix_has_a_line_with_its_photo_and_a_smaller_radius() {
        // One fix is of another place.
        let mut east_deg = [Some(0.0); 40];
        east_deg[20] = Some(0.01);
        let (frames, inputs) = flight(&east_deg);
        let lines = smoothed(&frames, &inputs);
        assert_eq!(lines.len(), 39, "the wrong fix is left out");
        assert!(lines.iter().all(|line| line.photo() != "20.jpg"));
        assert_eq!(lines[10].photo(), "10.jpg");
        assert!(lines[15].radius95_m.unwrap() < 4.0, "{:?}", lines[15]);
        // With a velocity of its time the frame has a line, but still no fix.
        let velocities = frames.iter().map(|(time_s, _)| {
            Input::Velocity(Velocity {
                time_s: *time_s,
                east_m_s: 0.0,
                north_m_s: 5.54,
                sigma_m_s: 0.5,
            })
        });
        let inputs: Vec<Input> = velocities.chain(inputs).collect();
        let lines = smoothed(&frames, &inputs);
        let of = |name: &str| lines.iter().find(|line| line.photo() == name).unwrap();
        assert_eq!(of("19.jpg").source, Some(Source::Fix));
        let wrong = of("20.jpg");
        assert_eq!((wrong.source, wrong.age_of_last_fix_s), (None, Some(0.5)));
    }
}
