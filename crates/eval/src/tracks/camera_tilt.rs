//! The same tilt of a camera as the track and as a photo's metadata write it.
//!
//! The track has yaw, pitch and roll about axes that turn with the aircraft (Z-Y-X). Metadata have the angle between the optical
//! axis and straight down and a turn about that axis (Z-Y-Z), as a gimbal has.

use grimnet_geo::turn_deg;
use grimnet_photo::{Metadata, Tilt};
use grimnet_track::Attitude;

/// Gimbal angles of a camera that looks down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GimbalAngles {
    /// Angle between the optical axis and straight down, degrees.
    pub from_nadir_deg: f64,
    /// Turn about the optical axis, degrees.
    pub roll_deg: f64,
    /// Bearing of the photo's top, at its centre on the ground, from the attitude's yaw, degrees clockwise.
    pub top_from_yaw_deg: f64,
}

impl GimbalAngles {
    /// The gimbal's angles for an attitude.
    #[must_use]
    pub fn of(attitude: &Attitude) -> Self {
        let [axis_deg, pitch_deg, roll_deg] = attitude.to_gimbal_deg();
        let from_nadir_deg = pitch_deg + 90.0;
        let top_deg = axis_deg + Tilt::top_from_yaw_deg(from_nadir_deg, roll_deg);
        Self {
            from_nadir_deg,
            roll_deg,
            top_from_yaw_deg: turn_deg(attitude.yaw_deg, top_deg),
        }
    }

    /// Metadata with these angles.
    #[must_use]
    pub fn metadata(&self) -> Metadata {
        Metadata {
            gimbal_pitch_deg: Some(self.from_nadir_deg - 90.0),
            gimbal_roll_deg: Some(self.roll_deg),
            orientation: 1,
            ..Metadata::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn attitude(pitch_deg: f64, roll_deg: f64) -> Attitude {
        Attitude {
            time_s: 0.0,
            yaw_deg: 0.0,
            pitch_deg,
            roll_deg,
        }
    }

    #[test]
    fn pitch_alone_is_the_gimbals_pitch_and_a_bank_is_a_turned_tilt() {
        let ahead = GimbalAngles::of(&attitude(9.0, 0.0));
        assert_relative_eq!(ahead.from_nadir_deg, 9.0, epsilon = 1e-9);
        assert_relative_eq!(ahead.roll_deg, 0.0, epsilon = 1e-9);
        assert_relative_eq!(ahead.top_from_yaw_deg, 0.0, epsilon = 1e-9);
        // Right side down looks to the left: the axis is yawed by -90 degrees and the picture turned back by 90.
        let left = GimbalAngles::of(&attitude(0.0, 25.0));
        assert_relative_eq!(left.from_nadir_deg, 25.0, epsilon = 1e-9);
        assert_relative_eq!(left.roll_deg, 90.0, epsilon = 1e-9);
        assert_relative_eq!(left.top_from_yaw_deg, 0.0, epsilon = 1e-9);
    }

    /// The top's bearing from the ground points just above and below the picture's centre, each from its ray.
    #[test]
    fn the_tops_bearing_is_that_of_the_ground() {
        let (pitch_deg, roll_deg) = (11.0, -24.0);
        let ground = |forward: f64| {
            let rotation = nalgebra::Rotation3::from_euler_angles(
                f64::to_radians(roll_deg),
                f64::to_radians(pitch_deg),
                0.0,
            );
            let ray = rotation * nalgebra::Vector3::new(forward, 0.0, 1.0);
            (ray.y / ray.z, ray.x / ray.z)
        };
        let (ahead, behind) = (ground(1e-4), ground(-1e-4));
        let bearing_deg = (ahead.0 - behind.0).atan2(ahead.1 - behind.1).to_degrees();
        let angles = GimbalAngles::of(&attitude(pitch_deg, roll_deg));
        assert_relative_eq!(angles.top_from_yaw_deg, bearing_deg, epsilon = 1e-6);
    }
}
