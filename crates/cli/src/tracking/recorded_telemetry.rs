//! Telemetry of a file, given to the flight as its frames come.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use grimnet_answer::printable_text;
use grimnet_geo::turn_deg;
use grimnet_link::{TelemetryClock, read_telemetry};
use grimnet_track::{Attitude, FixedMount, Input};

use super::frame_time::Epoch;
use super::video::has_ending;

/// What was recorded within so many seconds after a frame is given with it: its search and its motion take the nearest attitude.
const AHEAD_S: f64 = 0.25;
/// Telemetry that begins or ends so much later or earlier than a video does not fit it. Old drones write it once a second.
const LONGEST_GAP_S: f64 = 2.0;
/// By how much more, or less, tilt may change from an attitude to the next one than from the one before, degrees, that those between count.
/// They are off by an eighth of it: a line between two points of a curve.
const MOST_BEND_DEG: f64 = 8.0;

/// Endings of videos that may hold MISB metadata, lower case.
const TRANSPORT_STREAM_ENDINGS: &[&str] = &["ts", "m2ts", "mts"];

/// See the module.
pub struct RecordedTelemetry {
    path: PathBuf,
    clock: TelemetryClock,
    attitude_is_of_aircraft: bool,
    /// In order of time.
    inputs: VecDeque<Input>,
    /// In order of time.
    attitudes: Vec<Attitude>,
    is_checked: bool,
    /// Time of the latest input that was given, seconds.
    latest_s: Option<f64>,
    /// Whether there was a warning of frames without telemetry.
    warned_of_gap: bool,
}

impl RecordedTelemetry {
    /// Reads the file, whose times are late by so many seconds. A camera without a gimbal is mounted so.
    ///
    /// # Errors
    /// It cannot be read, or nothing in it can be used.
    pub fn read(path: &Path, delay_s: f64, mount: FixedMount) -> Result<Self> {
        crate::inputs::check_regular(path)?;
        let telemetry = read_telemetry(path)?.mounted(mount);
        if let Some(problem) = &telemetry.first_problem {
            tracing::warn!(
                "{}: {} records left out; the first: {}",
                path.display(),
                telemetry.left_out,
                printable_text(problem)
            );
        }
        if !telemetry.unread_columns.is_empty() {
            tracing::warn!(
                "{}: nothing is read from the columns {}: they have other names than the columns that are read, or lack those that belong to \
                 them (docs/autopilot.md, \"Telemetry from files\")",
                path.display(),
                printable_text(&telemetry.unread_columns.join(", "))
            );
        }
        let inputs: VecDeque<Input> = telemetry
            .inputs
            .iter()
            .map(|input| input.moved_in_time(-delay_s))
            .collect();
        let attitude_of = |input: &Input| match input {
            Input::Attitude(attitude) => Some(*attitude),
            _ => None,
        };
        Ok(Self {
            path: path.to_owned(),
            clock: telemetry.clock,
            attitude_is_of_aircraft: telemetry.attitude_is_of_aircraft,
            attitudes: inputs.iter().filter_map(attitude_of).collect(),
            inputs,
            is_checked: false,
            latest_s: None,
            warned_of_gap: false,
        })
    }

    /// The file beside a video. Nobody named it: where nothing in it can be used, as in subtitles of the position alone, there is a
    /// warning.
    pub fn beside(path: &Path, delay_s: f64) -> Option<Self> {
        Self::read(path, delay_s, FixedMount::default())
            .inspect_err(|error| tracing::warn!("{error:#}; the video is followed without it"))
            .ok()
    }

    /// The metadata in a video, if it is a transport stream that has some.
    pub fn within_video(video: &Path, delay_s: f64) -> Option<Self> {
        if !has_ending(video, TRANSPORT_STREAM_ENDINGS) || !video.is_file() {
            return None;
        }
        match Self::read(video, delay_s, FixedMount::default()) {
            Ok(telemetry) => {
                let path = video.display();
                tracing::info!("{path}: its KLV metadata give attitude, height and velocity");
                Some(telemetry)
            }
            Err(error) => {
                tracing::debug!("no telemetry in the video: {error}");
                None
            }
        }
    }

    /// Whether it has attitudes, and they are those of the aircraft.
    pub fn has_attitude_of_aircraft(&self) -> bool {
        self.attitude_is_of_aircraft && !self.attitudes.is_empty()
    }

    /// What was recorded up to a frame and was not given yet.
    ///
    /// # Errors
    /// At the first frame: the times of the file and of the frames do not count from the same moment.
    pub fn until(&mut self, frame_s: f64, epoch: Epoch) -> Result<Vec<Input>> {
        if !std::mem::replace(&mut self.is_checked, true) {
            self.check(frame_s, epoch)?;
        }
        let (mut given, gap) = self.take(frame_s);
        if let Some(gap) = gap {
            tracing::warn!("{}: {gap}", self.path.display());
        }
        given.extend(self.interpolated(frame_s).map(Input::Attitude));
        Ok(given)
    }

    /// The attitude of a frame between two that are so far apart that neither says anything of it: the filter takes none that is older
    /// than [`Attitude::HOLD_S`], nor a later one. Without it the camera would look straight down at some frames and ahead at others. The
    /// filter takes it for one that was measured, so there is none where the tilt swings faster than it was recorded.
    fn interpolated(&self, frame_s: f64) -> Option<Attitude> {
        let next = self
            .attitudes
            .partition_point(|attitude| attitude.time_s <= frame_s);
        let before = self.attitudes.get(next.checked_sub(1)?)?;
        let after = self.attitudes.get(next)?;
        let (age_s, interval_s) = (frame_s - before.time_s, after.time_s - before.time_s);
        let between = |from_deg: f64, to_deg: f64| {
            from_deg + turn_deg(from_deg, to_deg) * (age_s / interval_s)
        };
        let is_between = age_s > Attitude::HOLD_S && interval_s <= LONGEST_GAP_S;
        let is_steady = self.is_steady(next - 1) && self.is_steady(next);
        (is_between && is_steady).then(|| Attitude {
            time_s: frame_s,
            yaw_deg: between(before.yaw_deg, after.yaw_deg),
            pitch_deg: between(before.pitch_deg, after.pitch_deg),
            roll_deg: between(before.roll_deg, after.roll_deg),
        })
    }

    /// Whether the tilt goes on at an attitude about as it came, as far as its neighbours tell.
    fn is_steady(&self, at: usize) -> bool {
        let neighbours = at
            .checked_sub(1)
            .and_then(|before| self.attitudes.get(before..)?.first_chunk::<3>());
        let Some([before, here, after]) = neighbours else {
            return true;
        };
        let is_near = |a: &Attitude, b: &Attitude| b.time_s - a.time_s <= LONGEST_GAP_S;
        let bend_deg = |[a, b, c]: [f64; 3]| (turn_deg(b, c) - turn_deg(a, b)).abs();
        let pitch_deg = bend_deg([before.pitch_deg, here.pitch_deg, after.pitch_deg]);
        let roll_deg = bend_deg([before.roll_deg, here.roll_deg, after.roll_deg]);
        !(is_near(before, here) && is_near(here, after))
            || pitch_deg.hypot(roll_deg) <= MOST_BEND_DEG
    }

    /// The next inputs up to a frame, and the line on a gap that begins before it.
    fn take(&mut self, frame_s: f64) -> (Vec<Input>, Option<String>) {
        let end = self
            .inputs
            .partition_point(|input| input.time_s() <= frame_s + AHEAD_S);
        let given: Vec<Input> = self.inputs.drain(..end).collect();
        self.latest_s = given.last().map(Input::time_s).or(self.latest_s);
        let gap = self.new_gap(frame_s);
        (given, gap)
    }

    /// The warning at the first frame that is further from the telemetry before it than [`LONGEST_GAP_S`], and from what comes after
    /// it: a logger stopped, or its clock jumped.
    fn new_gap(&mut self, frame_s: f64) -> Option<String> {
        let is_far = |time_s: f64| (time_s - frame_s).abs() > LONGEST_GAP_S;
        let latest_s = self.latest_s.filter(|latest_s| is_far(*latest_s))?;
        let next_s = self.inputs.front().map(Input::time_s);
        if self.warned_of_gap || next_s.is_some_and(|next_s| !is_far(next_s)) {
            return None;
        }
        self.warned_of_gap = true;
        let next = next_s.map_or_else(
            || "no other follows".to_owned(),
            |next_s| format!("the next is {:.1} s newer", next_s - frame_s),
        );
        Some(format!(
            "a frame comes {:.1} s after its last record, and {next}: it stopped or its clock jumped, and frames are followed \
             without it there",
            frame_s - latest_s
        ))
    }

    /// Tells where the file does not cover a video, whose frames go from 0 s to `ends_s`.
    pub fn compare_with_video(&mut self, ends_s: f64) {
        let (Some(first), Some(last)) = (self.inputs.front(), self.inputs.back()) else {
            return;
        };
        if self.clock == TelemetryClock::Unix {
            return;
        }
        let path = self.path.display();
        let (first_s, last_s) = (first.time_s(), last.time_s());
        if first_s > LONGEST_GAP_S {
            tracing::warn!(
                "{path}: begins at {first_s:.1} s; the frames of the video before that are without telemetry"
            );
        }
        if last_s + LONGEST_GAP_S < ends_s {
            self.warned_of_gap = true;
            tracing::warn!(
                "{path}: ends at {last_s:.1} s, and the video at {ends_s:.1} s; the frames after {last_s:.1} s are without telemetry"
            );
        } else if last_s > ends_s + LONGEST_GAP_S {
            tracing::warn!(
                "{path}: ends at {last_s:.1} s, and the video already at {ends_s:.1} s; are both of the same flight, and is the video \
                 whole?"
            );
        }
    }

    fn check(&mut self, frame_s: f64, epoch: Epoch) -> Result<()> {
        let path = self.path.display();
        match (self.clock, epoch) {
            (TelemetryClock::Unix, Epoch::Start) => bail!(
                "{path}: its times are dates, and those of the frames are not: name the photos by date and time, or write \
                 seconds from the first frame (from the beginning of a video) into the file"
            ),
            (TelemetryClock::Video, Epoch::Unix) => bail!(
                "{path}: its times count from the beginning of a video, and those of the frames are dates"
            ),
            _ => {}
        }
        let (Some(first), Some(last)) = (self.inputs.front(), self.inputs.back()) else {
            return Ok(());
        };
        if frame_s > last.time_s() {
            self.warned_of_gap = true;
            tracing::warn!(
                "{path}: it ends at {:.1} s, before the first frame at {frame_s:.1} s, and is not used; are both of the same flight?",
                last.time_s()
            );
            // They would only set the clock of the track.
            self.inputs.clear();
        } else if frame_s + 3600.0 < first.time_s() {
            tracing::warn!(
                "{path}: it begins at {:.1} s, more than an hour after the first frame at {frame_s:.1} s; are both of the \
                 same flight?",
                first.time_s()
            );
        }
        Ok(())
    }
}

/// The SRT file beside a video, as DJI's drones write it.
pub fn beside_video(video: &Path) -> Option<PathBuf> {
    ["SRT", "srt"]
        .map(|ending| video.with_extension(ending))
        .into_iter()
        .find(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn telemetry_is_given_once_and_in_order_of_the_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.csv");
        fs_err::write(&path, "time,height_agl_m\n0,100\n1,101\n2,102\n3,103\n").unwrap();
        let mut telemetry = RecordedTelemetry::read(&path, 0.0, FixedMount::default()).unwrap();
        assert_eq!(telemetry.until(1.0, Epoch::Start).unwrap().len(), 2);
        assert_eq!(telemetry.until(1.1, Epoch::Start).unwrap().len(), 0);
        assert_eq!(telemetry.until(1.9, Epoch::Start).unwrap().len(), 1);
        assert_eq!(telemetry.until(99.0, Epoch::Start).unwrap().len(), 1);
    }

    #[test]
    fn a_frame_between_attitudes_that_are_far_apart_gets_one_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.csv");
        let text = "time,yaw_deg,pitch_deg,roll_deg\n0,350,10,0\n1,10,20,-5\n9,10,20,-5\n";
        fs_err::write(&path, text).unwrap();
        let telemetry = RecordedTelemetry::read(&path, 0.0, FixedMount::default()).unwrap();
        // The one before counts, none is before or after, and a gap.
        for frame_s in [0.0, 0.4, -0.3, 9.7, 5.0] {
            assert_eq!(telemetry.interpolated(frame_s), None, "{frame_s}");
        }
        let attitude = telemetry.interpolated(0.75).unwrap();
        let off_deg = [
            turn_deg(5.0, attitude.yaw_deg),
            attitude.pitch_deg - 17.5,
            attitude.roll_deg + 3.75,
        ];
        assert!(off_deg.iter().all(|off| off.abs() < 1e-9), "{attitude:?}");
    }

    #[test]
    fn no_attitude_is_made_up_while_the_camera_swings() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.csv");
        // Level, then by 10 degrees to either side.
        let text = "time,yaw_deg,pitch_deg,roll_deg\n0,0,20,0\n1,0,20,0\n2,0,20,0\n3,0,20,10\n4,0,20,-10\n5,0,20,10\n";
        fs_err::write(&path, text).unwrap();
        let telemetry = RecordedTelemetry::read(&path, 0.0, FixedMount::default()).unwrap();
        let is_there = [0.75, 1.75, 2.75, 3.75, 4.75].map(|s| telemetry.interpolated(s).is_some());
        assert_eq!(is_there, [true, false, false, false, false]);
    }

    #[test]
    fn times_that_count_from_another_moment_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.csv");
        fs_err::write(&path, "time,height_agl_m\n2026-05-01T12:00:00Z,100\n").unwrap();
        let mut telemetry = RecordedTelemetry::read(&path, 0.0, FixedMount::default()).unwrap();
        let error = telemetry.until(0.0, Epoch::Start).unwrap_err().to_string();
        assert!(
            error.contains("flight.csv") && error.contains("dates"),
            "{error}"
        );
    }

    #[test]
    fn the_subtitles_beside_a_video_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let video = folder.path().join("DJI_0001.MP4");
        assert_eq!(beside_video(&video), None);
        let srt = folder.path().join("DJI_0001.SRT");
        fs_err::write(&srt, "").unwrap();
        assert_eq!(beside_video(&video), Some(srt));
    }
}
