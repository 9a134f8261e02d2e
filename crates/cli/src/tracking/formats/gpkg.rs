//! A GeoPackage: positions, the track line and 95 % ellipses as layers.

use anyhow::Result;
use grimnet_answer::{TrackRecord, track_geopackage_of};

use super::super::line::{TrackLine, position_of_text, state_text};

/// A whole track as the bytes of a file.
///
/// # Errors
/// SQLite fails.
pub fn bytes_of(lines: &[TrackLine]) -> Result<Vec<u8>> {
    let times: Vec<String> = lines.iter().map(|line| line.time.to_string()).collect();
    let records = lines
        .iter()
        .zip(&times)
        .map(|(line, time)| record(line, time));
    Ok(track_geopackage_of(records)?)
}

fn record<'a>(line: &'a TrackLine, time: &'a str) -> TrackRecord<'a> {
    let note = line.note.as_ref();
    TrackRecord {
        time,
        photo: line.photo(),
        state: state_text(line.state),
        frame: note.map(|note| note.frame.text()),
        place: line.place(),
        heading_deg: line.heading_deg,
        radius95_m: line.radius95_m,
        covariance_en_m2: line.covariance_en_m2,
        velocity_en_m_s: [line.velocity_east_m_s, line.velocity_north_m_s],
        age_of_last_fix_s: line.age_of_last_fix_s,
        reason: note.and_then(|note| note.reason.as_deref()),
        position_of: line.position_of.map(position_of_text),
    }
}
