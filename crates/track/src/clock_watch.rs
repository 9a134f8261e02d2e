//! Whether a clock of the inputs was set: a step by GNSS, a correction of a real-time clock.
//!
//! A late input says nothing of the clock. Where all inputs of a source come at an impossible time, one after the other, its clock was
//! set. Camera and telemetry may have a clock each. The filter is on that of the camera, of which the positions are: if it was set, the
//! filter starts again at the new time, and telemetry is taken in only where it is of that time.

use crate::{error::InputError, input::Input, options::TrackOptions};

/// So many different times in a row must be impossible.
const CONFIRMATIONS: usize = 5;
/// Messages of one source swap by this, seconds.
const DISORDER_S: f64 = 1.0;
/// So many of the latest inputs are kept that were refused, of each source.
const MOST_HELD: usize = 64;

/// What is done with an input.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Verdict {
    /// It is taken in.
    Take,
    /// It is not.
    Refuse(InputError),
    /// The clock was set by so many seconds: the filter starts again with these inputs.
    StartAgain { by_s: f64, inputs: Vec<Input> },
}

/// Where inputs come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    Camera,
    Telemetry,
}

impl Source {
    fn of(input: &Input) -> Self {
        match input {
            Input::Motion(_) | Input::Fix(_) | Input::Miss(_) => Self::Camera,
            Input::Attitude(_) | Input::Height(_) | Input::Velocity(_) => Self::Telemetry,
        }
    }
}

/// What is known of the clock of one source.
#[derive(Debug, Clone, Default)]
struct Clock {
    /// Time of the newest input that was taken in, seconds.
    newest_s: Option<f64>,
    /// The latest inputs in a row that were refused for their time.
    held: Vec<Input>,
    /// Whether nothing shows that it is the camera's, by which the filter started again.
    is_apart: bool,
}

impl Clock {
    fn hold(&mut self, input: Input, lag_s: f64) {
        let goes_on = self.held.last().is_none_or(|last| {
            let since_s = input.time_s() - last.time_s();
            (-DISORDER_S..=lag_s).contains(&since_s)
        });
        if !goes_on {
            self.held.clear();
        } else if self.held.len() == MOST_HELD {
            self.held.remove(0);
        }
        self.held.push(input);
    }
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(crate) struct ClockWatch {
    camera: Clock,
    telemetry: Clock,
}

impl ClockWatch {
    /// Decides on an input by its time. `newest_s` is the time of the newest input that was taken in.
    pub fn check(
        &mut self,
        input: &Input,
        newest_s: Option<f64>,
        options: &TrackOptions,
    ) -> Verdict {
        let source = Source::of(input);
        let Some(error) = self.refusal(input, newest_s, options) else {
            self.take(source, input.time_s());
            return Verdict::Take;
        };
        let newest_s = newest_s.unwrap_or(input.time_s());
        self.clock_of(source).hold(*input, options.lag_s);
        let inputs = self.inputs_of_new_clock(newest_s, options.lag_s);
        if inputs.is_empty() {
            return Verdict::Refuse(error);
        }
        let by_s = self.step_s(newest_s);
        *self = Self::default();
        for input in &inputs {
            self.take(Source::of(input), input.time_s());
        }
        self.telemetry.is_apart = self.telemetry.newest_s.is_none();
        Verdict::StartAgain { by_s, inputs }
    }

    fn clock_of(&mut self, source: Source) -> &mut Clock {
        match source {
            Source::Camera => &mut self.camera,
            Source::Telemetry => &mut self.telemetry,
        }
    }

    fn take(&mut self, source: Source, time_s: f64) {
        let clock = self.clock_of(source);
        clock.newest_s = Some(
            clock
                .newest_s
                .map_or(time_s, |newest_s| newest_s.max(time_s)),
        );
        clock.held.clear();
        if self.camera.newest_s.is_some() {
            self.telemetry.is_apart &= source == Source::Camera;
        }
    }

    /// Forgets all but that the telemetry's clock has to be compared with the camera's.
    pub fn restart(&mut self) {
        *self = Self::default();
        self.telemetry.is_apart = true;
    }

    /// Why an input is not taken in at its time.
    fn refusal(
        &self,
        input: &Input,
        newest_s: Option<f64>,
        options: &TrackOptions,
    ) -> Option<InputError> {
        // Telemetry of a clock apart would carry the filter away from the camera's time.
        let is_apart = Source::of(input) == Source::Telemetry && self.telemetry.is_apart;
        let (from_s, most_ahead_s) = if is_apart {
            (self.camera.newest_s, options.lag_s)
        } else {
            (newest_s, options.clock_jump_s)
        };
        let by_s = input.time_s() - from_s?;
        if by_s > most_ahead_s || by_s < -options.clock_jump_s {
            Some(InputError::ClockJump { by_s })
        } else if by_s < -options.lag_s {
            Some(InputError::TooLate {
                age_s: -by_s,
                lag_s: options.lag_s,
            })
        } else {
            None
        }
    }

    /// The inputs that were refused and confirm a new clock, in order of time; none if they do not.
    fn inputs_of_new_clock(&self, newest_s: f64, lag_s: f64) -> Vec<Input> {
        let of_telemetry = self.telemetry.held.iter().copied();
        let mut inputs: Vec<Input> = match self.camera.held.last() {
            Some(last) => {
                let is_near = |input: &Input| (input.time_s() - last.time_s()).abs() <= lag_s;
                let of_camera = self.camera.held.iter().copied();
                of_camera.chain(of_telemetry).filter(is_near).collect()
            }
            // Without frames the telemetry alone tells the time.
            None if self.camera.is_silent(newest_s, lag_s) => of_telemetry.collect(),
            None => Vec::new(),
        };
        inputs.sort_by(Input::order);
        let mut times_s: Vec<f64> = inputs.iter().map(Input::time_s).collect();
        times_s.dedup();
        if times_s.len() < CONFIRMATIONS {
            inputs.clear();
        }
        inputs
    }

    /// By how much the clock was set, about, seconds.
    fn step_s(&self, newest_s: f64) -> f64 {
        let of = |clock: &Clock| {
            let first = clock.held.first()?;
            Some(first.time_s() - clock.newest_s.unwrap_or(newest_s))
        };
        of(&self.camera)
            .or_else(|| of(&self.telemetry))
            .unwrap_or(0.0)
    }
}

impl Clock {
    /// Whether nothing of it was taken in for long.
    fn is_silent(&self, newest_s: f64, lag_s: f64) -> bool {
        self.newest_s.is_none_or(|own_s| newest_s - own_s > lag_s)
    }
}
