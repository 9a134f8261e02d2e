//! Attitude of the camera.

use std::f64::consts::FRAC_PI_2;
use std::str::FromStr;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
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

    /// The same attitude as a gimbal states it, degrees: yaw of the optical axis, pitch (-90 looks straight down), and roll about the axis.
    /// The inverse of [`Self::from_gimbal`], but for a camera that looks straight down, whose roll is 0.
    pub fn to_gimbal_deg(&self) -> [f64; 3] {
        let down = self.rotation();
        let axis = down * Vector3::z();
        let horizontal = axis.x.hypot(axis.y);
        if horizontal < 1e-9 {
            return [self.yaw_deg, -90.0, 0.0];
        }
        let yaw_rad = axis.y.atan2(axis.x);
        let off_nadir_rad = horizontal.atan2(axis.z);
        let level = Rotation3::from_euler_angles(0.0, off_nadir_rad, yaw_rad);
        let top = level.inverse() * (down * Vector3::x());
        [
            yaw_rad.to_degrees().rem_euclid(360.0),
            off_nadir_rad.to_degrees() - 90.0,
            top.y.atan2(top.x).to_degrees(),
        ]
    }

    /// Turns the frame that carries the camera (x to the picture's top, y to its right, z along the optical axis) to north-east-down.
    pub(crate) fn rotation(&self) -> Rotation3<f64> {
        Rotation3::from_euler_angles(
            self.roll_deg.to_radians(),
            self.pitch_deg.to_radians(),
            self.yaw_deg.to_radians(),
        )
    }
}

/// How a camera without a gimbal is mounted on the aircraft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FixedMount {
    /// Where the picture's top points, degrees clockwise from the nose as seen from above.
    pub yaw_deg: f64,
    /// Pitch of the camera, degrees, as gimbals state it: -90 looks straight down, -60 towards the picture's top by 30 degrees.
    pub pitch_deg: f64,
}

impl Default for FixedMount {
    /// Straight down, the picture's top to the nose.
    fn default() -> Self {
        Self {
            yaw_deg: 0.0,
            pitch_deg: -90.0,
        }
    }
}

impl FixedMount {
    /// The camera's attitude where the aircraft's is `aircraft`.
    pub fn camera(&self, aircraft: Attitude) -> Attitude {
        if *self == Self::default() {
            return aircraft;
        }
        let body_from_camera = Rotation3::from_euler_angles(
            0.0,
            (self.pitch_deg + 90.0).to_radians(),
            self.yaw_deg.to_radians(),
        );
        let down = UnitQuaternion::from(aircraft.rotation() * body_from_camera);
        Attitude::looking_down(aircraft.time_s, &down)
    }
}

/// Turns and pitches that are accepted, degrees: a camera that looks further up than 75 degrees from straight down shows no usable ground.
const MOUNT_YAW_RANGE_DEG: std::ops::RangeInclusive<f64> = -360.0..=360.0;
const MOUNT_PITCH_RANGE_DEG: std::ops::RangeInclusive<f64> = -165.0..=-15.0;

/// `YAW`, or `YAW,PITCH`, degrees.
impl FromStr for FixedMount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (yaw, pitch) = text.split_once(',').unwrap_or((text, "-90"));
        let number = |text: &str| text.trim().parse::<f64>().ok();
        match (number(yaw), number(pitch)) {
            (Some(yaw_deg), Some(pitch_deg))
                if MOUNT_YAW_RANGE_DEG.contains(&yaw_deg)
                    && MOUNT_PITCH_RANGE_DEG.contains(&pitch_deg) =>
            {
                Ok(Self { yaw_deg, pitch_deg })
            }
            _ => Err(
                "expected YAW or YAW,PITCH in degrees: where the picture's top points, clockwise from the nose (-360 to 360), and the \
                 camera's pitch (-165 to -15; -90 looks straight down)"
                    .to_owned(),
            ),
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

    #[test]
    fn the_angles_of_a_gimbal_are_read_back() {
        for angles in [
            [30.0, -60.0, 0.0],
            [300.0, -80.0, 25.0],
            [10.0, -20.0, -170.0],
        ] {
            let [yaw, pitch, roll] = angles;
            let back = Attitude::from_gimbal(0.0, yaw, pitch, roll).to_gimbal_deg();
            for (back, angle) in back.iter().zip(angles) {
                assert!((back - angle).abs() < 1e-9, "{back} {angles:?}");
            }
        }
        let down = Attitude::from_gimbal(0.0, 30.0, -90.0, 20.0);
        let [yaw, pitch, roll] = down.to_gimbal_deg();
        assert!((yaw - 50.0).abs() < 1e-9 && pitch == -90.0 && roll == 0.0);
        // The right wing is down: the camera looks to the left, the picture's top still to the nose.
        let banked = Attitude {
            pitch_deg: 0.0,
            roll_deg: 30.0,
            ..down
        };
        let [yaw, pitch, roll] = banked.to_gimbal_deg();
        assert!((yaw - 320.0).abs() < 1e-9, "{yaw}");
        assert!((pitch + 60.0).abs() < 1e-9 && (roll - 90.0).abs() < 1e-9);
    }

    #[test]
    fn a_mount_turns_and_tilts_the_camera_on_the_aircraft() {
        let aircraft = Attitude {
            time_s: 7.0,
            yaw_deg: 40.0,
            pitch_deg: 4.0,
            roll_deg: -3.0,
        };
        let mounted = |text: &str| text.parse::<FixedMount>().unwrap().camera(aircraft);
        assert_eq!(mounted("0"), aircraft);
        // The picture's top to the right wing, which is up by 3 degrees; its right side to the tail, which is down by 4.
        let right = mounted("90");
        for (value, expected) in [
            (right.time_s, 7.0),
            (right.yaw_deg, 130.0),
            (right.pitch_deg, 3.0),
            (right.roll_deg, 4.0),
        ] {
            assert!((value - expected).abs() < 0.3, "{right:?}");
        }
        // To the tail.
        let back = mounted("180");
        assert!((back.pitch_deg + 4.0).abs() < 1e-9 && (back.roll_deg - 3.0).abs() < 1e-9);
        let level = Attitude {
            pitch_deg: 0.0,
            roll_deg: 0.0,
            ..aircraft
        };
        let ahead = "-90,-60".parse::<FixedMount>().unwrap().camera(level);
        let gimbal = Attitude::from_gimbal(7.0, 310.0, -60.0, 0.0);
        assert!((ahead.yaw_deg - gimbal.yaw_deg).abs() < 1e-9);
        assert!((ahead.pitch_deg - gimbal.pitch_deg).abs() < 1e-9);
        for wrong in ["", "nose", "NaN", "361", "0,-10", "0,", "0,-90,0"] {
            assert!(wrong.parse::<FixedMount>().is_err(), "{wrong}");
        }
    }
}
