//! Telemetry files of any kind.

use std::{
    fs::File,
    io::{self, Read as _, Seek as _},
    path::Path,
};

use super::{csv, dji_srt, klv, mpeg_ts, recorded::Telemetry};
use crate::error::LinkError;

/// Larger files are refused, bytes; videos are not read into memory. An hour of video has less than 50 MB of telemetry in any of the formats.
const MOST_BYTES: u64 = 1 << 30;
/// The format is told from so many bytes at the beginning.
const HEAD_BYTES: usize = 4096;

/// Reads a telemetry file: CSV, the SRT subtitles of a DJI drone, or MISB ST 0601 KLV, alone or in an MPEG transport stream. The
/// content decides which.
///
/// # CSV
/// The first line names the columns, which commas, semicolons or tabs separate; other columns are ignored, empty cells and NaN are unknown.
/// Beside semicolons and tabs numbers may have a comma before their fraction.
///
/// | column | unit |
/// |---|---|
/// | `time` | seconds, or date and time as RFC 3339 (`2026-05-01T12:00:00.25Z`) |
/// | `yaw_deg`, `pitch_deg`, `roll_deg` | attitude of an aircraft with a fixed camera that looks down, the picture's top to the nose: degrees clockwise from true north, nose up, right side down |
/// | `gimbal_yaw_deg`, `gimbal_pitch_deg`, `gimbal_roll_deg` | attitude of a camera on a gimbal, in place of the three above: pitch -90 looks down; without roll it is 0 |
/// | `height_agl_m`, `altitude_amsl_m` | metres above ground and above mean sea level |
/// | `velocity_east_m_s`, `velocity_north_m_s`, `velocity_sigma_m_s` | metres per second over ground; without sigma it is 0.5 |
///
/// # SRT
/// Height above the take-off point, and the gimbal's attitude where the drone writes it (`gb_yaw` or `G.PRY`). Times are those of
/// the subtitles. The position is not read.
///
/// # KLV
/// In a transport stream (`flight.ts`), asynchronous or synchronous: times are those of the stream, in seconds from its first frame,
/// so that they fit the video. Alone, as ffmpeg extracts it (`ffmpeg -i flight.ts -map 0:d -c copy -f data flight.klv`), times are
/// those in the packets. Packets with a wrong checksum are left out, and such as state more than 64 KiB.
///
/// # Errors
/// [`LinkError::Telemetry`] if the file cannot be read, is none of these, or nothing in it can be used.
pub fn read_telemetry(path: &Path) -> Result<Telemetry, LinkError> {
    let wrong = |reason: String| LinkError::Telemetry {
        path: path.to_owned(),
        reason,
    };
    let unreadable = |error: io::Error| wrong(error.to_string());
    let mut file = File::open(path).map_err(unreadable)?;
    let mut bytes = Vec::new();
    (&mut file)
        .take(HEAD_BYTES as u64)
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    let telemetry = if let Some(prefix) = mpeg_ts::prefix_bytes(&bytes) {
        file.rewind().map_err(unreadable)?;
        klv::of_transport_stream(&mpeg_ts::units(file, prefix).map_err(unreadable)?)
    } else {
        file.take(MOST_BYTES + 1 - bytes.len() as u64)
            .read_to_end(&mut bytes)
            .map_err(unreadable)?;
        if bytes.len() as u64 > MOST_BYTES {
            return Err(wrong(
                "larger than 1 GiB, which no telemetry file is".to_owned(),
            ));
        }
        parse(&bytes).map_err(wrong)?
    };
    if telemetry.inputs.is_empty() {
        let problem = telemetry
            .first_problem
            .map(|problem| format!(": {problem}"));
        return Err(wrong(format!(
            "no attitude, height or velocity in it{}{}",
            problem.unwrap_or_default(),
            if telemetry.unread_columns.is_empty() {
                String::new()
            } else {
                format!("; columns that are read: {}", csv::names())
            }
        )));
    }
    Ok(telemetry)
}

/// Reads the content of a telemetry file.
///
/// # Errors
/// What is wrong.
pub(crate) fn parse(bytes: &[u8]) -> Result<Telemetry, String> {
    if klv::is_klv(bytes) {
        return Ok(klv::parse(bytes));
    }
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(HEAD_BYTES)]);
    if head.contains("-->") {
        return Ok(dji_srt::parse(&String::from_utf8_lossy(bytes)));
    }
    csv::parse(bytes)
}

#[cfg(test)]
mod tests {
    use super::super::recorded::TelemetryClock;
    use super::*;
    use grimnet_track::Input;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
            let _ = parse(&bytes);
            let _ = klv::parse(&bytes);
            let _ = dji_srt::parse(&String::from_utf8_lossy(&bytes));
        }

        #[test]
        fn any_text_is_read_or_refused(text in "(time|[0-9eE+.:,TZ-]{0,12}|\n|rel_alt|gb_yaw: |G.PRY \\(|-->|,){0,80}") {
            let _ = parse(text.as_bytes());
            let telemetry = dji_srt::parse(&text);
            for input in telemetry.inputs {
                prop_assert!(input.time_s().is_finite());
            }
        }
    }

    #[test]
    fn files_that_hold_nothing_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.csv");
        for (text, reason) in [
            ("", "expected a line with the names of columns"),
            ("a,b\n1,2\n", "no column `time`"),
            ("time,height_agl_m\n", "no attitude, height or velocity"),
            ("time,height_agl_m\nx,1\n", "line 2"),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = read_telemetry(&path).unwrap_err().to_string();
            assert!(
                error.contains("flight.csv") && error.contains(reason),
                "{error}"
            );
        }
        // The first bytes of a log of ArduPilot.
        std::fs::write(&path, b"\xa3\x95\x80\x80\x59FMT").unwrap();
        let error = read_telemetry(&path).unwrap_err().to_string();
        assert!(
            error.contains("neither CSV nor SRT nor MISB KLV"),
            "{error}"
        );
        let error = read_telemetry(&folder.path().join("none.srt")).unwrap_err();
        assert!(error.to_string().contains("none.srt"));
    }

    #[test]
    fn packets_of_a_video_have_its_times() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/klv.ts");
        let telemetry = read_telemetry(&path).unwrap();
        assert_eq!(telemetry.clock, TelemetryClock::Video);
        // Six asynchronous and three synchronous packets with attitude and height.
        assert_eq!((telemetry.inputs.len(), telemetry.left_out), (18, 0));
        let times: Vec<f64> = telemetry.inputs.iter().map(Input::time_s).collect();
        assert_eq!(times[0], 0.0);
        assert!(
            times.is_sorted() && (1.5..2.0).contains(&times[17]),
            "{times:?}"
        );
    }
}
