//! A rendered flight as a file: an evaluation that was stopped goes on where it was, and one with more minutes renders only what
//! is new.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::rendered::FlownFrames;

#[derive(Serialize)]
struct Written<'a> {
    conditions: &'a str,
    flown: &'a FlownFrames,
}

#[derive(Deserialize)]
struct Read {
    conditions: String,
    flown: FlownFrames,
}

/// The file's content. `conditions` are in words all that the frames depend on.
///
/// # Errors
/// A figure cannot be written.
pub fn stored_flight(conditions: &str, flown: &FlownFrames) -> Result<Vec<u8>, serde_json::Error> {
    serde_json::to_vec(&Written { conditions, flown })
}

/// Reads such a file. `None` if there is none, or it was made under other conditions: the flight is then rendered.
#[must_use]
pub fn read_stored_flight(path: &Path, conditions: &str) -> Option<FlownFrames> {
    let read: Read = serde_json::from_slice(&fs_err::read(path).ok()?).ok()?;
    (read.conditions == conditions).then_some(read.flown)
}

#[cfg(test)]
mod tests {
    use grimnet_track::simulation::{Delivered, FixSample};
    use grimnet_track::{Input, Miss, TrackOptions};

    use super::*;
    use crate::tracks::frame_record::{FrameRecord, MeasuredFix};
    use crate::tracks::ground_cover::Cover;

    #[test]
    fn a_flight_is_read_bit_for_bit_and_only_under_its_own_conditions() {
        let flown = FlownFrames {
            inputs: vec![Delivered {
                arrival_s: 0.1 + 0.2,
                input: Input::Miss(Miss { time_s: 1.0 / 3.0 }),
            }],
            frames: vec![FrameRecord {
                time_s: 1.0 / 3.0,
                cover: Some(Cover::Snow),
                tracked: true,
                fix: Some(MeasuredFix {
                    sample: FixSample {
                        error_en_m: [0.1, -1e-17],
                        covariance_en_m2: [1.0 / 7.0, 0.0, 2.0],
                        confidence: 0.987_654_321_012_345_6,
                        heading_error_deg: -0.3,
                        gsd_ratio: 1.01,
                    },
                    error_m: 0.1,
                    relief_en_m: [0.0; 2],
                }),
                motion: None,
                time_ms: 20.5,
            }],
            options: TrackOptions::default(),
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.json");
        assert_eq!(read_stored_flight(&path, "world 7"), None);
        fs_err::write(&path, stored_flight("world 7", &flown).unwrap()).unwrap();
        assert_eq!(read_stored_flight(&path, "world 7"), Some(flown));
        assert_eq!(read_stored_flight(&path, "world 8"), None);
        fs_err::write(&path, b"{\"conditions\":").unwrap();
        assert_eq!(read_stored_flight(&path, "world 7"), None);
    }
}
