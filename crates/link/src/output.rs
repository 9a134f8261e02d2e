//! Which message carries positions to which autopilot, and how often.

use std::{fmt, str::FromStr};

use crate::autopilot::{Autopilot, AutopilotKind};

/// The message that carries positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Output {
    /// ODOMETRY: for ArduPilot, and for PX4 before 1.18. Metres from the origin of the autopilot's local frame.
    Odometry,
    /// GLOBAL_POSITION_SENSOR: for PX4 from 1.18.
    GlobalPositionSensor,
    /// The command MAV_CMD_EXTERNAL_POSITION_ESTIMATE, which sets the position once a second while fixes support it: for ArduPilot
    /// from 4.5 and PX4 from 1.15 while they have no other position.
    PositionEstimate,
    /// GPS_INPUT, which ArduPilot takes for a GNSS receiver. Only where nothing else is possible: it hides that the position
    /// comes from a camera.
    GpsInput,
}

impl Output {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Odometry,
        Self::GlobalPositionSensor,
        Self::PositionEstimate,
        Self::GpsInput,
    ];

    /// The best one for an autopilot.
    #[must_use]
    pub fn for_autopilot(autopilot: &Autopilot) -> Self {
        match (autopilot.kind, autopilot.version) {
            (AutopilotKind::Px4, Some(version)) if version.is_at_least(1, 18) => {
                Self::GlobalPositionSensor
            }
            _ => Self::Odometry,
        }
    }

    /// How often it is sent, hertz.
    ///
    /// PX4 ignores external vision below 5 Hz and asks for 30 to 50. ArduPilot holds a source unhealthy after 300 ms
    /// (ODOMETRY) or an average interval of 215 ms (GPS_INPUT).
    #[must_use]
    pub fn rate_hz(self, kind: AutopilotKind) -> f64 {
        match (self, kind) {
            (Self::Odometry, AutopilotKind::ArduPilot) | (Self::GpsInput, _) => 10.0,
            (Self::Odometry, _) => 30.0,
            (Self::GlobalPositionSensor, _) => 5.0,
            (Self::PositionEstimate, _) => 1.0,
        }
    }

    /// The short name, which [`FromStr`] reads.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Odometry => "odometry",
            Self::GlobalPositionSensor => "global-position-sensor",
            Self::PositionEstimate => "position-estimate",
            Self::GpsInput => "gps-input",
        }
    }
}

impl FromStr for Output {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|output| output.name() == text)
            .ok_or_else(|| {
                let names: Vec<&str> = Self::ALL.iter().map(|output| output.name()).collect();
                format!("expected {}", names.join(", "))
            })
    }
}

impl fmt::Display for Output {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Odometry => "ODOMETRY",
            Self::GlobalPositionSensor => "GLOBAL_POSITION_SENSOR",
            Self::PositionEstimate => "MAV_CMD_EXTERNAL_POSITION_ESTIMATE",
            Self::GpsInput => "GPS_INPUT",
        })
    }
}
