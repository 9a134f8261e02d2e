//! How the camera is mounted on the aircraft.

use std::{fmt, str::FromStr};

/// How the camera is mounted, and so what an autopilot's telemetry says of its attitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum CameraMount {
    /// On the first gimbal that reports its attitude, and on no other one later; as [`Self::Fixed`] as long as none reports.
    #[default]
    GimbalIfReported,
    /// On the gimbal with this number: its MAVLink component, or 1 to 6 for one that the autopilot reports (`gimbal_device_id`).
    Gimbal(u8),
    /// Fixed to the aircraft ([`grimnet_track::FixedMount`]).
    Fixed,
    /// In a way that nothing tells: the telemetry gives no attitude of the camera.
    Unknown,
}

impl FromStr for CameraMount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = text.strip_prefix("gimbal:").map(str::parse);
        match (text, named) {
            ("gimbal", _) => Ok(Self::GimbalIfReported),
            ("fixed", _) => Ok(Self::Fixed),
            ("unknown", _) => Ok(Self::Unknown),
            (_, Some(Ok(id))) if id > 0 => Ok(Self::Gimbal(id)),
            _ => Err("expected gimbal, gimbal:ID (1 to 255), fixed or unknown".to_owned()),
        }
    }
}

impl fmt::Display for CameraMount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GimbalIfReported => f.write_str("gimbal"),
            Self::Gimbal(id) => write!(f, "gimbal:{id}"),
            Self::Fixed => f.write_str("fixed"),
            Self::Unknown => f.write_str("unknown"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        for mount in [
            CameraMount::GimbalIfReported,
            CameraMount::Gimbal(154),
            CameraMount::Fixed,
            CameraMount::Unknown,
        ] {
            assert_eq!(mount.to_string().parse(), Ok(mount));
        }
        for wrong in ["", "Fixed", "gimbal:", "gimbal:0", "gimbal:256", "154"] {
            assert!(wrong.parse::<CameraMount>().is_err(), "{wrong}");
        }
    }
}
