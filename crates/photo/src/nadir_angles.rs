//! Angles of a camera that count from straight down, as fixed-wing aircraft record them.

use crate::camera::Tilt;
use crate::view::CameraAttitude;

/// The attitude of a camera that looked straight down with its picture's top to the yaw's bearing, was then turned up by
/// `pitch_deg` and about its picture's top by `roll_deg` (right side down: it looks to the left), and the bearing of its picture's
/// top relative to that yaw, degrees clockwise.
///
/// A roll about the picture's top tilts the camera to the side. [`CameraAttitude`] has a tilt along its own yaw and a turn about
/// the optical axis in place of it.
pub(crate) fn from_nadir_angles(pitch_deg: f64, roll_deg: f64) -> (CameraAttitude, f64) {
    let (sin_pitch, cos_pitch) = pitch_deg.to_radians().sin_cos();
    let (sin_roll, cos_roll) = roll_deg.to_radians().sin_cos();
    // The optical axis: ahead of the yaw, to its right, and down.
    let (ahead, right) = (sin_pitch * cos_roll, -sin_roll);
    let down = cos_pitch * cos_roll;
    // Of the two tilts along one line the one that looks ahead if the pitch does, so that without roll nothing changes.
    let sign = if ahead < 0.0 { -1.0 } else { 1.0 };
    let tilt = sign * ahead.hypot(right).atan2(down);
    let turn = (sign * right).atan2(sign * ahead);
    // The picture's top, along the right and the top of the camera that is tilted and not turned about its axis.
    let (sin_tilt, cos_tilt) = tilt.sin_cos();
    let along_right = -cos_pitch * turn.sin();
    let along_top = cos_pitch * turn.cos() * cos_tilt + sin_pitch * sin_tilt;
    let attitude = CameraAttitude {
        pitch_from_nadir_deg: tilt.to_degrees(),
        roll_deg: along_right.atan2(along_top).to_degrees(),
    };
    let top_deg = turn.to_degrees()
        + Tilt::top_from_yaw_deg(attitude.pitch_from_nadir_deg, attitude.roll_deg);
    (attitude, top_deg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::{Rotation3, Vector3};

    /// Against rotations: yaw, pitch and roll about z (down), y (right) and x (the picture's top).
    #[test]
    fn a_roll_tilts_to_the_side() {
        for (pitch, roll) in [
            (0.0, 0.0),
            (4.25, -1.5),
            (0.0, 10.0),
            (-5.0, 12.0),
            (-8.0, 0.0),
            (40.0, -20.0),
        ] {
            let ned = |roll: f64, pitch: f64, yaw: f64| {
                Rotation3::from_euler_angles(
                    roll.to_radians(),
                    pitch.to_radians(),
                    yaw.to_radians(),
                )
            };
            let (attitude, top_deg) = from_nadir_angles(pitch, roll);
            let expected = ned(roll, pitch, 0.0);
            let own_yaw =
                top_deg - Tilt::top_from_yaw_deg(attitude.pitch_from_nadir_deg, attitude.roll_deg);
            let about_axis =
                Rotation3::from_axis_angle(&Vector3::z_axis(), attitude.roll_deg.to_radians());
            let got = ned(0.0, attitude.pitch_from_nadir_deg, own_yaw) * about_axis;
            assert_relative_eq!(got.matrix(), expected.matrix(), epsilon = 1e-12);
            // Where a step up the picture leads on the ground, by hand.
            let (pitch, roll) = (pitch.to_radians(), roll.to_radians());
            let by_hand = (-roll.sin() * pitch.sin()).atan2(roll.cos());
            assert_relative_eq!(top_deg, by_hand.to_degrees(), epsilon = 1e-9);
        }
    }

    #[test]
    fn without_a_roll_nothing_changes() {
        for pitch in [-20.0, 0.0, 35.0] {
            let (attitude, top_deg) = from_nadir_angles(pitch, 0.0);
            assert_relative_eq!(attitude.pitch_from_nadir_deg, pitch, epsilon = 1e-12);
            assert_relative_eq!(attitude.roll_deg, 0.0, epsilon = 1e-12);
            assert_relative_eq!(top_deg, 0.0, epsilon = 1e-12);
        }
    }
}
