//! Who is at the other end.

use std::fmt;

use mavlink::{
    MavHeader,
    dialects::common::{HEARTBEAT_DATA, MavAutopilot, MavComponent, MavType},
};

/// The autopilot's software.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum AutopilotKind {
    /// ArduPilot.
    ArduPilot,
    /// PX4.
    Px4,
    /// Another one that speaks MAVLink.
    Other,
}

/// Version of the autopilot's software, as AUTOPILOT_VERSION.flight_sw_version has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// First number.
    pub major: u8,
    /// Second number.
    pub minor: u8,
    /// Third number.
    pub patch: u8,
}

impl Version {
    /// From `flight_sw_version`: major, minor, patch and kind of release from the highest byte down. `None` for 0.
    pub(crate) fn from_flight_sw_version(value: u32) -> Option<Self> {
        let [major, minor, patch, _] = value.to_be_bytes();
        (value != 0).then_some(Self {
            major,
            minor,
            patch,
        })
    }

    /// Whether it is this version or a later one.
    #[must_use]
    pub fn is_at_least(self, major: u8, minor: u8) -> bool {
        (self.major, self.minor) >= (major, minor)
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

/// An autopilot that was heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Autopilot {
    /// MAVLink system.
    pub system_id: u8,
    /// MAVLink component, 1 as a rule.
    pub component_id: u8,
    /// Its software.
    pub kind: AutopilotKind,
    /// Version of the software. `None` until it is told.
    pub version: Option<Version>,
}

impl Autopilot {
    /// The autopilot that sent a heartbeat. `None` if it was something else: a ground station, a camera, a companion.
    pub(crate) fn from_heartbeat(header: &MavHeader, heartbeat: &HEARTBEAT_DATA) -> Option<Self> {
        let kind = match heartbeat.autopilot {
            MavAutopilot::MAV_AUTOPILOT_INVALID => return None,
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => AutopilotKind::ArduPilot,
            MavAutopilot::MAV_AUTOPILOT_PX4 => AutopilotKind::Px4,
            _ => AutopilotKind::Other,
        };
        if header.component_id != MavComponent::MAV_COMP_ID_AUTOPILOT1 as u8
            || heartbeat.mavtype == MavType::MAV_TYPE_GCS
        {
            return None;
        }
        Some(Self {
            system_id: u8::try_from(header.system_id).ok()?,
            component_id: header.component_id,
            kind,
            version: None,
        })
    }

    /// Whether a message is from it.
    pub(crate) fn sent(&self, header: &MavHeader) -> bool {
        header.system_id == u32::from(self.system_id) && header.component_id == self.component_id
    }
}

impl fmt::Display for Autopilot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.kind {
            AutopilotKind::ArduPilot => "ArduPilot",
            AutopilotKind::Px4 => "PX4",
            AutopilotKind::Other => "unknown software",
        })?;
        if let Some(version) = self.version {
            write!(f, " {version}")?;
        }
        write!(f, ", system {}", self.system_id)
    }
}
