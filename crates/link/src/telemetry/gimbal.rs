//! From the attitude of a camera's optical axis to the attitude that the filter takes.

use std::f64::consts::FRAC_PI_2;

use grimnet_track::Attitude;
use nalgebra::UnitQuaternion;

/// The attitude of a camera of which `forward` turns its frame (x along the optical axis, y to the right of the picture, z to
/// its bottom) to north-east-down.
///
/// The filter's frame has x to the picture's top and z along the optical axis: it is turned by 90 degrees about y. Doing so
/// before angles are taken keeps clear of the pitch of -90 degrees, where yaw and roll are one.
pub(crate) fn attitude_of_camera(time_s: f64, forward: &UnitQuaternion<f64>) -> Attitude {
    attitude_looking_down(
        time_s,
        &(forward * UnitQuaternion::from_euler_angles(0.0, FRAC_PI_2, 0.0)),
    )
}

/// The attitude of a camera of which `down` turns its frame (x to the picture's top, y to its right, z along the optical axis)
/// to north-east-down. For a camera that is fixed to the aircraft and looks down, that is the aircraft's attitude.
pub(crate) fn attitude_looking_down(time_s: f64, down: &UnitQuaternion<f64>) -> Attitude {
    let (roll, pitch, yaw) = down.euler_angles();
    Attitude {
        time_s,
        yaw_deg: yaw.to_degrees().rem_euclid(360.0),
        pitch_deg: pitch.to_degrees(),
        roll_deg: roll.to_degrees(),
    }
}

/// The attitude of a camera on a gimbal with these angles (yaw, pitch, roll in this order; pitch -90 looks down), degrees.
pub(crate) fn attitude_from_gimbal_angles(
    time_s: f64,
    yaw_deg: f64,
    pitch_deg: f64,
    roll_deg: f64,
) -> Attitude {
    attitude_of_camera(
        time_s,
        &UnitQuaternion::from_euler_angles(
            roll_deg.to_radians(),
            pitch_deg.to_radians(),
            yaw_deg.to_radians(),
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_track::Attitude;

    fn assert_same(a: Attitude, b: Attitude) {
        let turn = (a.yaw_deg - b.yaw_deg + 540.0).rem_euclid(360.0) - 180.0;
        assert!(turn.abs() < 1e-6, "{a:?} {b:?}");
        assert!((a.pitch_deg - b.pitch_deg).abs() < 1e-6, "{a:?} {b:?}");
        assert!((a.roll_deg - b.roll_deg).abs() < 1e-6, "{a:?} {b:?}");
    }

    #[test]
    fn without_roll_it_is_the_pitch_and_90_degrees() {
        for yaw_deg in [0.0, 33.0, 200.0, 359.0] {
            for pitch_deg in [-90.0, -89.9, -80.0, -45.0] {
                assert_same(
                    attitude_from_gimbal_angles(1.0, yaw_deg, pitch_deg, 0.0),
                    Attitude::from_gimbal(1.0, yaw_deg, pitch_deg, 0.0),
                );
            }
        }
    }

    #[test]
    fn looking_down_yaw_and_roll_turn_the_picture_alike() {
        // With pitch -90 the roll turns about the same axis as the yaw.
        assert_same(
            attitude_from_gimbal_angles(1.0, 40.0, -90.0, 30.0),
            attitude_from_gimbal_angles(1.0, 70.0, -90.0, 0.0),
        );
    }
}
