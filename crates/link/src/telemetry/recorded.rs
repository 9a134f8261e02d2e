//! What a telemetry file holds.

use grimnet_track::{FixedMount, Input};

/// Error of a velocity per axis that is stated without one, metres per second, 1 sigma.
pub const VELOCITY_SIGMA_M_S: f64 = 0.5;

/// What the times of a telemetry file count from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum TelemetryClock {
    /// 1970-01-01 UTC.
    Unix,
    /// The beginning of the video that the file belongs to.
    Video,
    /// As whoever wrote the file chose; the frames have to be on the same clock.
    Own,
}

/// Recorded telemetry.
#[derive(Debug, Clone, PartialEq)]
pub struct Telemetry {
    /// In order of time.
    pub inputs: Vec<Input>,
    /// What the times count from.
    pub clock: TelemetryClock,
    /// Whether the attitudes are those of the aircraft: a camera without a gimbal has them, if it looks straight down with the picture's
    /// top to the nose.
    pub attitude_is_of_aircraft: bool,
    /// Records that could not be read and were left out.
    pub left_out: usize,
    /// What was wrong with the first of them.
    pub first_problem: Option<String>,
    /// Columns of a table that are not read: of another name, or without those that belong to them.
    pub unread_columns: Vec<String>,
}

impl Telemetry {
    pub(crate) fn new(clock: TelemetryClock) -> Self {
        Self {
            inputs: Vec::new(),
            clock,
            attitude_is_of_aircraft: false,
            left_out: 0,
            first_problem: None,
            unread_columns: Vec::new(),
        }
    }

    /// The attitudes of a camera that is mounted so on the aircraft; those of a gimbal stay.
    #[must_use]
    pub fn mounted(mut self, mount: FixedMount) -> Self {
        if self.attitude_is_of_aircraft {
            for input in &mut self.inputs {
                if let Input::Attitude(attitude) = input {
                    *attitude = mount.camera(*attitude);
                }
            }
        }
        self
    }

    /// Leaves out a record.
    pub(crate) fn leave_out(&mut self, problem: impl FnOnce() -> String) {
        self.left_out += 1;
        self.first_problem.get_or_insert_with(problem);
    }

    pub(crate) fn sorted(mut self) -> Self {
        self.inputs
            .sort_by(|a, b| a.time_s().total_cmp(&b.time_s()));
        self
    }
}
