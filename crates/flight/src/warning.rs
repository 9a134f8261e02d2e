//! What a flight warns of: a clock that was set, and telemetry that its fixes contradict.

use crate::consistency::delay::DelayWarning;
use crate::consistency::height::HeightWarning;
use crate::consistency::tilt::TiltWarning;
use crate::consistency::velocity::VelocityWarning;
use crate::consistency::yaw::YawWarning;

/// Something that is wrong with the inputs of a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// The clock of frames and telemetry was set. The flight goes on at the new time.
    Clock(ClockWarning),
    /// The times of the telemetry. The filter goes on to use them.
    Delay(DelayWarning),
    /// Its yaw. The flight goes on without attitude: pitch and roll are about axes that are turned by as much, or about unknown ones.
    Yaw(YawWarning),
    /// Its pitch and roll. The flight goes on without attitude.
    Tilt(TiltWarning),
    /// Its height. The flight goes on without it.
    Height(HeightWarning),
    /// Its velocities. The flight goes on without them until they agree with the fixes again.
    Velocity(VelocityWarning),
}

impl Warning {
    /// What it is about, in a word or two.
    pub fn about(&self) -> &'static str {
        match self {
            Self::Clock(_) => "clock",
            Self::Delay(_) => "times of the telemetry",
            Self::Yaw(_) => "yaw",
            Self::Tilt(_) => "tilt",
            Self::Height(_) => "height",
            Self::Velocity(_) => "velocity",
        }
    }
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Clock(warning) => warning.fmt(f),
            Self::Delay(warning) => warning.fmt(f),
            Self::Yaw(warning) => write!(f, "{warning}; the flight goes on without attitude"),
            Self::Tilt(warning) => write!(f, "{warning}; the flight goes on without attitude"),
            Self::Height(warning) => write!(f, "{warning}; the flight goes on without them"),
            Self::Velocity(warning) => write!(
                f,
                "{warning}; the flight goes on without them until they agree with the fixes again"
            ),
        }
    }
}

/// A clock was set during the flight, the latest time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockWarning {
    /// By how much, about, seconds: negative if it was set back.
    pub by_s: f64,
}

impl std::fmt::Display for ClockWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let side = if self.by_s < 0.0 { "back" } else { "ahead" };
        write!(
            f,
            "the clock of the frames was set {side} by about {:.0} s during the flight: the track begins again at the new time, and \
             telemetry counts where it is of that time",
            self.by_s.abs()
        )
    }
}
