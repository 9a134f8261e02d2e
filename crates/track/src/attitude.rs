//! Attitude of the camera.

use std::f64::consts::FRAC_PI_2;

use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

/// Attitude of the frame that carries the camera: of the gimbal, or of the aircraft where the camera is fixed to it.
///
/// Rotations in the order yaw, pitch, roll (Z-Y-X) from north-east-down. With pitch and roll 0 the camera looks straight down
/// and the photo's top points to `yaw_deg`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Attitude {
    /// Seconds.
    pub time_s: f64,
    /// Degrees clockwise from true north.
    pub yaw_deg: f64,
    /// Degrees, positive with the nose up: a camera that looks down then looks ahead.
    pub pitch_deg: f64,
    /// Degrees, positive with the right side down: a camera that looks down then looks to the left.
    pub roll_deg: f64,
}

impl Attitude {
    /// An attitude says nothing of a photo that is further away in time than this, seconds.
    pub const HOLD_S: f64 = 0.5;

    /// The attitude of a gimbal whose pitch is -90 degrees when it looks straight down, as DJI and MAVLink report it: its optical
    /// axis is the x axis of its frame, so that the roll turns the photo about its centre.
    pub fn from_gimbal(
        time_s: f64,
        yaw_deg: f64,
        gimbal_pitch_deg: f64,
        gimbal_roll_deg: f64,
    ) -> Self {
        let forward = UnitQuaternion::from_euler_angles(
            gimbal_roll_deg.to_radians(),
            gimbal_pitch_deg.to_radians(),
            yaw_deg.to_radians(),
        );
        Self::of_camera(time_s, &forward)
    }

    /// The attitude of a camera of which `forward` turns its frame (x along the optical axis, y to the right of the picture, z to
    /// its bottom) to north-east-down.
    ///
    /// This attitude's frame has x to the picture's top and z along the optical axis: it is turned by 90 degrees about y. Doing
    /// so before angles are taken keeps clear of the pitch of -90 degrees, where yaw and roll are one.
    pub fn of_camera(time_s: f64, forward: &UnitQuaternion<f64>) -> Self {
        Self::looking_down(
            time_s,
            &(forward * UnitQuaternion::from_euler_angles(0.0, FRAC_PI_2, 0.0)),
        )
    }

    /// The attitude of a camera of which `down` turns its frame (x to the picture's top, y to its right, z along the optical axis)
    /// to north-east-down. For a camera that is fixed to the aircraft and looks down, that is the aircraft's attitude.
    pub fn looking_down(time_s: f64, down: &UnitQuaternion<f64>) -> Self {
        let (roll_rad, pitch_rad, yaw_rad) = down.euler_angles();
        Self {
            time_s,
            yaw_deg: yaw_rad.to_degrees().rem_euclid(360.0),
            pitch_deg: pitch_rad.to_degrees(),
            roll_deg: roll_rad.to_degrees(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};

    use super::*;

    #[test]
    fn the_roll_of_a_gimbal_turns_the_photo_about_its_centre() {
        let level = Attitude::from_gimbal(0.0, 30.0, -80.0, 0.0);
        for (value, expected) in [
            (level.yaw_deg, 30.0),
            (level.pitch_deg, 10.0),
            (level.roll_deg, 0.0),
        ] {
            assert!((value - expected).abs() < 1e-9, "{level:?}");
        }
        // Straight down a roll is a turn of the photo, and the camera still looks straight down.
        let turned = Attitude::from_gimbal(0.0, 30.0, -90.0, 20.0);
        assert!((turned.yaw_deg - 50.0).abs() < 1e-9, "{turned:?}");
        assert!(turned.pitch_deg.abs() < 1e-9 && turned.roll_deg.abs() < 1e-9);
        // Tilted, the optical axis stays where it is.
        let axis = |a: Attitude| {
            Rotation3::from_euler_angles(
                a.roll_deg.to_radians(),
                a.pitch_deg.to_radians(),
                a.yaw_deg.to_radians(),
            ) * Vector3::z()
        };
        let rolled = Attitude::from_gimbal(0.0, 30.0, -80.0, 20.0);
        assert!((axis(rolled) - axis(level)).norm() < 1e-12);
    }
}
