//! A recorded flight: everything that the filter was given, in this order, and what it answered.
//!
//! `flight.jsonl` holds one JSON object per line: the filter's options, telemetry, and frames with their inputs, the photo's name
//! and hash, and the line of the track.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use grimnet_output::{FolderFile, OutputFolder, OutputPolicy};
use grimnet_track::{Input, TrackOptions, Tracker};
use serde::{Deserialize, Serialize};

use super::frame_time::Epoch;
use super::line::{FrameNote, TrackLine};

/// The file in the folder.
pub const FLIGHT_FILE: &str = "flight.jsonl";
/// Version of the lines; another number is refused.
const VERSION: u32 = 1;

/// One line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Entry {
    /// The first line; again when a photo stated the focal length.
    Options {
        version: u32,
        options: Box<TrackOptions>,
    },
    /// Telemetry.
    Input(Input),
    /// A frame.
    Frame {
        /// Exposure time, seconds.
        time_s: f64,
        epoch: Epoch,
        /// BLAKE3 of the photo's file.
        hash: String,
        /// Whether the filter was restarted for it.
        #[serde(default)]
        after_restart: bool,
        /// What the filter was given for it.
        inputs: Vec<Input>,
        note: FrameNote,
        /// The line of the track.
        answer: serde_json::Value,
    },
}

/// Writes a recording as the flight goes on.
pub struct Recorder {
    file: FolderFile,
    options: Option<TrackOptions>,
}

impl Recorder {
    /// Starts a recording in a folder, which is made if it is not there. Until the flight ends it is in `flight.jsonl.partial`. An
    /// earlier recording that the program wrote there is replaced.
    ///
    /// # Errors
    /// The folder cannot be written, or holds a recording that was changed since or comes from elsewhere.
    pub fn create(folder: &Path, policy: &OutputPolicy) -> Result<Self> {
        let folder = OutputFolder::open(folder, policy)?;
        folder.check([FLIGHT_FILE])?;
        Ok(Self {
            file: folder.create_partial(FLIGHT_FILE)?,
            options: None,
        })
    }

    /// Records telemetry that the filter was given.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn input(&mut self, input: Input, options: &TrackOptions) -> Result<()> {
        self.keep_options(options)?;
        if is_recordable(&input) {
            self.write(&Entry::Input(input))?;
        }
        Ok(())
    }

    /// Records a frame.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn frame(
        &mut self,
        (time_s, epoch): (f64, Epoch),
        hash: &str,
        (after_restart, inputs): (bool, &[Input]),
        note: &FrameNote,
        answer: &TrackLine,
        options: &TrackOptions,
    ) -> Result<()> {
        self.keep_options(options)?;
        let inputs = inputs.iter().copied().filter(is_recordable).collect();
        self.write(&Entry::Frame {
            time_s,
            epoch,
            hash: hash.to_owned(),
            after_restart,
            inputs,
            note: note.clone(),
            answer: serde_json::to_value(answer)?,
        })?;
        // A recording is for the moment at which the process ends without a warning.
        Ok(self.file.flush()?)
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(self) -> Result<()> {
        Ok(self.file.commit()?)
    }

    fn keep_options(&mut self, options: &TrackOptions) -> Result<()> {
        if self.options.as_ref() == Some(options) {
            return Ok(());
        }
        self.options = Some(options.clone());
        self.write(&Entry::Options {
            version: VERSION,
            options: Box::new(options.clone()),
        })
    }

    fn write(&mut self, entry: &Entry) -> Result<()> {
        let mut line = serde_json::to_string(entry)?;
        line.push('\n');
        self.file.write_all(line.as_bytes())?;
        Ok(())
    }
}

/// JSON has no text for a time that is not finite; the filter refuses such an input without changing.
fn is_recordable(input: &Input) -> bool {
    input.time_s().is_finite()
}

/// Reads a recording and runs it through a filter again.
pub struct Replay {
    path: PathBuf,
    others: Vec<PathBuf>,
    text: BufReader<File>,
    number: usize,
    tracker: Option<Tracker>,
}

/// A frame of a recording.
pub struct Replayed {
    /// The track as it comes out now.
    pub line: TrackLine,
    /// Whether it is what was recorded.
    pub is_same: bool,
}

impl Replay {
    /// Opens a recording: a file, or the newest one of a folder. One that was interrupted is taken as far as it goes.
    ///
    /// # Errors
    /// There is none, or the folder cannot be read.
    pub fn open(given: &Path) -> Result<Self> {
        let found = if given.is_dir() {
            newest_first(given)?
        } else {
            vec![given.to_owned()]
        };
        let mut found = found.into_iter();
        let path = found.next().unwrap_or_else(|| given.join(FLIGHT_FILE));
        crate::inputs::check_regular(&path).with_context(|| {
            format!(
                "{}: expected a folder that a flight was recorded into, or a recording in it",
                given.display()
            )
        })?;
        let file = File::open(&path).with_context(|| format!("cannot read {}", path.display()))?;
        Ok(Self {
            path,
            others: found.collect(),
            text: BufReader::new(file),
            number: 0,
            tracker: None,
        })
    }

    /// The file that is read.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The other recordings of the folder, newest first.
    pub fn others(&self) -> &[PathBuf] {
        &self.others
    }

    /// The next frame; `None` at the end.
    ///
    /// # Errors
    /// The recording is damaged or of another version.
    pub fn next_frame(&mut self) -> Result<Option<Replayed>> {
        while let Some(entry) = self.next_entry()? {
            match entry {
                Entry::Options { version, options } => self.set_options(version, *options)?,
                Entry::Input(input) => {
                    // What was refused then is refused now.
                    let _ = self.tracker()?.push(input);
                }
                Entry::Frame {
                    time_s,
                    epoch,
                    after_restart,
                    inputs,
                    note,
                    answer,
                    ..
                } => {
                    let tracker = self.tracker()?;
                    if after_restart {
                        tracker.restart();
                    }
                    for input in inputs {
                        let _ = tracker.push(input);
                    }
                    let point = tracker.point_at(time_s);
                    let line = TrackLine::new(time_s, epoch, point.as_ref(), Some(note));
                    let is_same = serde_json::to_value(&line)? == answer;
                    return Ok(Some(Replayed { line, is_same }));
                }
            }
        }
        Ok(None)
    }

    fn next_entry(&mut self) -> Result<Option<Entry>> {
        self.number += 1;
        let place = format!("{}, line {}", self.path.display(), self.number);
        let mut line = Vec::new();
        let read = self.text.read_until(b'\n', &mut line);
        read.with_context(|| place.clone())?;
        if line.is_empty() {
            return Ok(None);
        }
        match serde_json::from_slice(&line) {
            Ok(entry) => Ok(Some(entry)),
            // A power cut or a full disk ended it.
            Err(_) if !line.ends_with(b"\n") => {
                tracing::warn!("{place}: the last line is incomplete and left out");
                Ok(None)
            }
            Err(error) => {
                Err(error).with_context(|| format!("{place}: not a line of a recorded flight"))
            }
        }
    }

    fn set_options(&mut self, version: u32, options: TrackOptions) -> Result<()> {
        if version != VERSION {
            bail!(
                "{}: recorded by another version of grim (recording {version}, expected {VERSION})",
                self.path.display()
            );
        }
        match (&mut self.tracker, options.focal_length_px) {
            (Some(tracker), Some(focal_length_px)) => {
                tracker.set_focal_length_px(focal_length_px);
            }
            (Some(_), None) => {}
            (None, _) => self.tracker = Some(Tracker::new(options)?),
        }
        Ok(())
    }

    fn tracker(&mut self) -> Result<&mut Tracker> {
        match &mut self.tracker {
            Some(tracker) => Ok(tracker),
            None => bail!(
                "{}: does not begin with the filter's options",
                self.path.display()
            ),
        }
    }
}

/// The recordings of a folder, the one written last first: the finished one, and those that were interrupted.
fn newest_first(folder: &Path) -> Result<Vec<PathBuf>> {
    let partial = format!("{FLIGHT_FILE}.partial");
    let mut found = Vec::new();
    for entry in fs_err::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if !name.is_some_and(|name| name == FLIGHT_FILE || name.starts_with(&partial)) {
            continue;
        }
        // One that has just got its final name is no longer there.
        if let Ok(metadata) = path.metadata()
            && metadata.is_file()
        {
            found.push((metadata.modified()?, path));
        }
    }
    found.sort();
    Ok(found.into_iter().rev().map(|(_, path)| path).collect())
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use grimnet_geo::LonLat;
    use grimnet_track::{PositionFix, Velocity};

    use super::super::line::FrameResult;
    use super::*;

    fn fix(time_s: f64) -> Input {
        Input::Fix(PositionFix {
            time_s,
            lonlat: LonLat::new(
                120.7,
                24.2 + (time_s - 1_782_036_000.0) * 1.234_567_890_123e-5,
            ),
            covariance_en_m2: [1.0 / 3.0, 0.1, 0.7],
            map_error_m: 1.0,
            heading_deg: Some(1.0 / 7.0),
            gsd_m: 0.05,
            confidence: 0.99,
        })
    }

    fn recorded(folder: &Path) {
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        let mut recorder = Recorder::create(folder, &OutputPolicy::new()).unwrap();
        for frame in 0..12 {
            let time_s = 1_782_036_000.0 + f64::from(frame) / 3.0;
            let velocity = Input::Velocity(Velocity {
                time_s,
                east_m_s: 0.1,
                north_m_s: 4.0,
                sigma_m_s: 0.3,
            });
            tracker.push(velocity).unwrap();
            recorder.input(velocity, tracker.options()).unwrap();
            tracker.set_focal_length_px(2000.0);
            let inputs = [fix(time_s), fix(f64::NAN)];
            for input in inputs {
                let _ = tracker.push(input);
            }
            let note = FrameNote {
                photo: format!("{frame}.jpg"),
                frame: FrameResult::Fix,
                reason: None,
                time_ms: 1.5,
            };
            let point = tracker.point_at(time_s);
            let line = TrackLine::new(time_s, Epoch::Unix, point.as_ref(), Some(note.clone()));
            let at = (time_s, Epoch::Unix);
            recorder
                .frame(at, "00", (false, &inputs), &note, &line, tracker.options())
                .unwrap();
        }
        // A process that is killed here leaves all of them.
        let partial = folder.join(format!("{FLIGHT_FILE}.partial"));
        let text = fs_err::read_to_string(partial).unwrap();
        assert_eq!(
            text.lines()
                .filter(|line| line.contains("\"hash\""))
                .count(),
            12
        );
        recorder.finish().unwrap();
    }

    fn replayed(folder: &Path) -> Vec<Replayed> {
        let mut replay = Replay::open(folder).unwrap();
        std::iter::from_fn(|| replay.next_frame().unwrap()).collect()
    }

    #[test]
    fn a_recording_gives_the_same_track_again() {
        let folder = tempfile::tempdir().unwrap();
        recorded(folder.path());
        let frames = replayed(folder.path());
        assert_eq!(frames.len(), 12);
        assert!(frames.iter().all(|frame| frame.is_same));
        assert!(frames[11].line.lat_deg.is_some());
    }

    #[test]
    fn a_changed_recording_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        recorded(folder.path());
        let path = folder.path().join(FLIGHT_FILE);
        let text = fs_err::read_to_string(&path).unwrap();
        fs_err::write(
            &path,
            text.replacen("\"north_m_s\":4.0", "\"north_m_s\":4.5", 6),
        )
        .unwrap();
        assert!(!replayed(folder.path()).iter().all(|frame| frame.is_same));
        for (text, expected) in [
            ("{}\n".to_owned(), "line 1"),
            (
                text.replacen("\"version\":1", "\"version\":9", 1),
                "another version",
            ),
        ] {
            fs_err::write(&path, text).unwrap();
            let error = Replay::open(folder.path())
                .unwrap()
                .next_frame()
                .err()
                .unwrap();
            assert!(format!("{error:#}").contains(expected), "{error:#}");
        }
        assert!(Replay::open(Path::new("/no/such")).is_err());
        assert!(Replay::open(tempfile::tempdir().unwrap().path()).is_err());
    }

    #[test]
    fn an_incomplete_last_line_is_the_end_and_another_one_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        recorded(folder.path());
        let path = folder.path().join(FLIGHT_FILE);
        let text = fs_err::read_to_string(&path).unwrap();
        // Only the line's end is missing.
        fs_err::write(&path, text.trim_end()).unwrap();
        assert_eq!(replayed(folder.path()).len(), 12);
        let torn = &text[..text.len() - 30];
        fs_err::write(&path, torn).unwrap();
        assert_eq!(replayed(folder.path()).len(), 11);
        fs_err::write(&path, [torn.as_bytes(), b"\xff\0\0"].concat()).unwrap();
        assert_eq!(replayed(folder.path()).len(), 11);
        fs_err::write(&path, format!("{torn}\n")).unwrap();
        let mut replay = Replay::open(folder.path()).unwrap();
        let error = std::iter::from_fn(|| replay.next_frame().transpose())
            .find_map(Result::err)
            .unwrap();
        assert!(format!("{error:#}").contains("not a line"), "{error:#}");
    }

    #[test]
    fn the_recording_that_was_written_last_is_replayed_and_a_file_reaches_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        recorded(folder.path());
        let whole = fs_err::read_to_string(path(FLIGHT_FILE)).unwrap();
        let names = [
            FLIGHT_FILE,
            "flight.jsonl.partial",
            "flight.jsonl.partial-2",
        ];
        let up_to_frame = |count: usize| {
            let lines = whole.split_inclusive('\n');
            let mut frames = 0;
            let kept = lines.take_while(|line| {
                frames += usize::from(line.contains("\"hash\""));
                frames <= count
            });
            kept.collect::<String>()
        };
        fs_err::write(path(names[1]), up_to_frame(5)).unwrap();
        fs_err::write(path(names[2]), up_to_frame(3)).unwrap();
        fs_err::write(path("flight.csv"), "newer, and no recording").unwrap();
        let counts = [12, 5, 3];
        for newest in 0..3 {
            for (number, name) in names.iter().enumerate() {
                let is_newest = u64::from(number == newest);
                let written = SystemTime::UNIX_EPOCH + Duration::from_secs(1000 + is_newest);
                let file = File::options().write(true).open(path(name)).unwrap();
                file.set_modified(written).unwrap();
            }
            assert_eq!(replayed(folder.path()).len(), counts[newest]);
            let replay = Replay::open(folder.path()).unwrap();
            assert_eq!(replay.path(), path(names[newest]));
            assert_eq!(replay.others().len(), 2);
        }
        for (name, count) in names.iter().zip(counts) {
            assert_eq!(replayed(&path(name)).len(), count);
            assert!(Replay::open(&path(name)).unwrap().others().is_empty());
        }
    }

    #[test]
    fn an_own_recording_is_replaced_and_that_of_others_is_not() {
        let folder = tempfile::tempdir().unwrap();
        recorded(folder.path());
        let path = folder.path().join(FLIGHT_FILE);
        let first = fs_err::read_to_string(&path).unwrap();
        // A second flight that is never finished loses nothing of the first one, and one of which nothing is known leaves nothing.
        let mut second = Recorder::create(folder.path(), &OutputPolicy::new()).unwrap();
        second.input(fix(0.0), &TrackOptions::default()).unwrap();
        drop(second);
        assert_eq!(fs_err::read_to_string(&path).unwrap(), first);
        let partial = folder.path().join(format!("{FLIGHT_FILE}.partial"));
        fs_err::remove_file(partial).unwrap();
        drop(Recorder::create(folder.path(), &OutputPolicy::new()).unwrap());
        assert_eq!(replayed(folder.path()).len(), 12);
        recorded(folder.path());
        assert_eq!(replayed(folder.path()).len(), 12);
        let mut text = fs_err::read_to_string(&path).unwrap();
        text.push_str("{}\n");
        fs_err::write(&path, &text).unwrap();
        let error = Recorder::create(folder.path(), &OutputPolicy::new())
            .err()
            .unwrap();
        assert!(error.to_string().contains(FLIGHT_FILE), "{error:#}");
        assert_eq!(fs_err::read_to_string(&path).unwrap(), text);
    }
}
