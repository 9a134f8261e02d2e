//! One flight of the program: frames and telemetry in, lines of the track out.

use std::collections::HashSet;

use anyhow::Result;
use grimnet_flight::{ClockWarning, DelayWarning, Flight, Known, Searched, Warning};
use grimnet_track::{Input, InputError, TrackPoint};

use super::frame_time::Epoch;
use super::frames::Frame;
use super::line::{FrameNote, FrameResult, TrackLine};
use super::recording::Recorder;
use crate::errors;
use grimnet_answer::{Answer, printable};

/// How the frames of a flight went.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames.
    pub frames: usize,
    /// Frames with a position on the map.
    pub fixes: usize,
    /// Frames that could not be used.
    pub unusable: usize,
    /// Frames at which the position may be used.
    pub usable: usize,
}

/// See the module.
pub struct Session {
    flight: Flight,
    epoch: Epoch,
    known: Known,
    recorder: Option<Recorder>,
    /// All inputs, for smoothing.
    inputs: Option<Vec<Input>>,
    counts: Counts,
    /// What there was a warning of, so that there is only one.
    warned: HashSet<&'static str>,
    /// Whether it was warned of velocities that are left out now.
    is_velocity_wrong: bool,
    /// The last step of a clock that there was a warning of.
    clock_step: Option<ClockWarning>,
}

/// A frame and what it gave.
pub struct Tracked {
    /// As it is written.
    pub line: TrackLine,
    /// Exposure time, seconds.
    pub time_s: f64,
    /// The track at that time.
    pub point: Option<TrackPoint>,
    /// The answer for the photo alone.
    #[cfg_attr(
        not(feature = "serve"),
        allow(
            dead_code,
            reason = "builds without the service write no session files"
        )
    )]
    pub answer: Answer,
    /// Where it was searched.
    #[cfg_attr(
        not(feature = "serve"),
        allow(
            dead_code,
            reason = "builds without the service write no session files"
        )
    )]
    pub searched: Searched,
}

impl Session {
    /// A session before its first frame. What is `known` holds for all frames.
    pub fn new(
        flight: Flight,
        known: Known,
        recorder: Option<Recorder>,
        keep_inputs: bool,
    ) -> Self {
        Self {
            flight,
            epoch: Epoch::Start,
            known,
            recorder,
            inputs: keep_inputs.then(Vec::new),
            counts: Counts::default(),
            warned: HashSet::new(),
            is_velocity_wrong: false,
            clock_step: None,
        }
    }

    /// The flight.
    pub fn flight(&self) -> &Flight {
        &self.flight
    }

    /// How the frames went so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// All inputs so far, if they are kept, without what the fixes contradict.
    pub fn inputs(&self) -> Vec<Input> {
        let kept = self.inputs.iter().flatten();
        let left_out = self.flight.left_out();
        kept.filter(move |input| !left_out.contains(input))
            .copied()
            .collect()
    }

    /// Takes in telemetry. What the filter refuses gets a warning, one of each kind.
    ///
    /// # Errors
    /// The recording cannot be written.
    pub fn push(&mut self, input: Input) -> Result<()> {
        match self.flight.push(input) {
            Ok(Some(_)) => {}
            Ok(None) => return Ok(()),
            Err(error) => {
                if self.warned.insert(kind(&error)) {
                    tracing::warn!(
                        "telemetry left out: {error} (further ones are left out without a warning)"
                    );
                }
            }
        }
        if let Some(inputs) = &mut self.inputs {
            inputs.push(input);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.input(input, self.flight.tracker().options())?;
        }
        Ok(())
    }

    /// Takes in a frame. One that cannot be used gets a warning and stops nothing.
    ///
    /// # Errors
    /// The recording cannot be written.
    pub fn frame(&mut self, frame: Frame, epoch: Epoch) -> Result<Tracked> {
        self.epoch = epoch;
        let time_s = frame.time_s;
        let (point, (after_restart, inputs), note, answer, searched) = match &frame.photo {
            Ok(photo) => {
                let answer = self.flight.frame(photo, time_s, &self.known);
                for error in &answer.refused {
                    tracing::warn!("{}: {error}", printable(&frame.name));
                }
                if let Err(error) = &answer.outcome {
                    tracing::warn!("{}: {error}", printable(&frame.name));
                }
                self.show_warnings();
                let note = FrameNote::of(&frame.name, &answer);
                let alone = match &answer.outcome {
                    Ok(outcome) => Answer::of(&frame.name, outcome),
                    Err(error) => Answer::no_fix(&frame.name, error),
                };
                let given = (answer.after_restart, answer.inputs);
                (answer.point, given, note, alone, answer.searched)
            }
            Err(error) => {
                let message = errors::message_with_hint(error);
                tracing::warn!("{}: {}", printable(&frame.name), printable(&message));
                let note = FrameNote::unusable(&frame.name, error);
                let alone = Answer::no_fix(&frame.name, message);
                let point = self.flight.point_at(time_s);
                (point, (false, Vec::new()), note, alone, Searched::WholeMap)
            }
        };
        self.count(note.frame, point.as_ref());
        if let Some(kept) = &mut self.inputs {
            kept.extend(&inputs);
        }
        let line = TrackLine::new(time_s, epoch, point.as_ref(), Some(note.clone()));
        if let Some(recorder) = &mut self.recorder {
            let options = self.flight.tracker().options();
            let given = (after_restart, inputs.as_slice());
            recorder.frame((time_s, epoch), &frame.hash, given, &note, &line, options)?;
        }
        Ok(Tracked {
            line,
            time_s,
            point,
            answer,
            searched,
        })
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn finish(self) -> Result<()> {
        self.recorder.map_or(Ok(()), Recorder::finish)
    }

    /// Warns of what the fixes contradict, once of each kind, of each step of a clock, and of velocities each time that they are left
    /// out; they alone return.
    fn show_warnings(&mut self) {
        let was_velocity_wrong = std::mem::take(&mut self.is_velocity_wrong);
        for warning in self.flight.warnings() {
            let is_new = match warning {
                Warning::Clock(step) => self.clock_step.replace(step) != Some(step),
                Warning::Velocity(_) => {
                    self.is_velocity_wrong = true;
                    !was_velocity_wrong
                }
                _ => self.warned.insert(warning.about()),
            };
            match warning {
                _ if !is_new => {}
                Warning::Delay(DelayWarning { delay_s }) => {
                    tracing::warn!(
                        "{warning}; with `--telemetry-delay {delay_s}` a recorded one fits"
                    );
                }
                _ => tracing::warn!("{warning}"),
            }
        }
        if was_velocity_wrong && !self.is_velocity_wrong {
            tracing::warn!(
                "the reported velocities agree with the fixes again, and are used again"
            );
        }
    }

    fn count(&mut self, result: FrameResult, point: Option<&TrackPoint>) {
        self.counts.frames += 1;
        match result {
            FrameResult::Fix => self.counts.fixes += 1,
            FrameResult::NoFix => {}
            FrameResult::Unusable => self.counts.unusable += 1,
        }
        self.counts.usable += usize::from(point.is_some_and(|point| point.state.is_usable()));
    }
}

fn kind(error: &InputError) -> &'static str {
    match error {
        InputError::Invalid { field, .. } => field,
        InputError::TooLate { .. } => "too late",
        InputError::ClockJump { .. } => "clock jump",
        _ => "other",
    }
}
