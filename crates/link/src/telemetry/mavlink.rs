//! Telemetry of an autopilot.

use grimnet_track::{Attitude, FixedMount, HEIGHT_AGL_RANGE_M, Height, Input, Velocity};
use mavlink::dialects::common::{
    ALTITUDE_DATA, GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, GLOBAL_POSITION_INT_DATA,
    LOCAL_POSITION_NED_DATA, MavMessage,
};
use nalgebra::{Quaternion, UnitQuaternion};

use super::{
    camera_mount::CameraMount,
    gimbal::{GimbalClock, gimbal_id, is_relative_to_north},
    recorded::VELOCITY_SIGMA_M_S,
};
use crate::{autopilot::AutopilotKind, messages::OwnState};

/// For so long after a better message the worse one of the same kind is not taken, seconds.
const PREFER_S: f64 = 1.0;
/// What the autopilot said longer ago does not hold, seconds.
const HOLD_S: f64 = 1.0;
/// The ground that a rangefinder measured longer ago is no longer the ground below, seconds: a roof or a valley was passed by then.
const GROUND_HOLD_S: f64 = 30.0;

/// What is read of an autopilot's telemetry, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TelemetryOptions {
    /// How the camera is mounted.
    pub camera_mount: CameraMount,
    /// How a camera without a gimbal is mounted on the aircraft.
    pub fixed_mount: FixedMount,
    /// Error of the autopilot's velocity per axis, metres per second, 1 sigma. `None`: velocities are not read.
    pub velocity_sigma_m_s: Option<f64>,
}

impl Default for TelemetryOptions {
    fn default() -> Self {
        Self {
            camera_mount: CameraMount::default(),
            fixed_mount: FixedMount::default(),
            velocity_sigma_m_s: Some(VELOCITY_SIGMA_M_S),
        }
    }
}

/// A value and when it came, seconds on the link's clock.
type Stamped<T> = Option<(f64, T)>;

fn recent<T: Copy>(stamped: Stamped<T>, now_s: f64, hold_s: f64) -> Option<T> {
    stamped
        .filter(|(came_s, _)| now_s - came_s <= hold_s)
        .map(|(_, value)| value)
}

/// Turns messages of an autopilot and its gimbals into inputs.
#[derive(Debug)]
pub(crate) struct MavlinkTelemetry {
    options: TelemetryOptions,
    kind: AutopilotKind,
    attitude: Stamped<UnitQuaternion<f64>>,
    attitude_angles: Stamped<()>,
    /// The gimbal that carries the camera, once it reported.
    gimbal: Option<u8>,
    gimbal_clock: GimbalClock,
    local: Stamped<(f64, f64)>,
    relative_m: Stamped<f64>,
    amsl_m: Stamped<f64>,
    above_ground: Stamped<()>,
    /// How far the ground below was under the home position when a rangefinder last measured it, metres.
    home_above_ground_m: Stamped<f64>,
}

impl MavlinkTelemetry {
    pub fn new(options: TelemetryOptions, kind: AutopilotKind) -> Self {
        Self {
            options,
            kind,
            attitude: None,
            attitude_angles: None,
            gimbal: None,
            gimbal_clock: GimbalClock::default(),
            local: None,
            relative_m: None,
            amsl_m: None,
            above_ground: None,
            home_above_ground_m: None,
        }
    }

    /// The number of the gimbal that carries the camera. `None` until it reports.
    pub fn gimbal(&self) -> Option<u8> {
        self.gimbal
    }

    /// What the autopilot says of itself at present.
    pub fn own_state(&self, now_s: f64) -> OwnState {
        let local = recent(self.local, now_s, HOLD_S);
        let relative = recent(self.relative_m, now_s, HOLD_S);
        OwnState {
            attitude: recent(self.attitude, now_s, HOLD_S),
            down_m: local
                .map(|(down_m, _)| down_m)
                .or(relative.map(|height_m| -height_m)),
            velocity_down_m_s: local.map(|(_, velocity)| velocity),
            altitude_amsl_m: recent(self.amsl_m, now_s, HOLD_S),
        }
    }

    /// Takes in a message of the autopilot that came at `now_s`. `time_s` turns seconds since the autopilot's start into the link's clock.
    pub fn take(
        &mut self,
        message: &MavMessage,
        now_s: f64,
        time_s: &dyn Fn(f64) -> f64,
        inputs: &mut Vec<Input>,
    ) {
        let boot = |time_boot_ms: u32| time_s(f64::from(time_boot_ms) * 1e-3);
        match message {
            MavMessage::ATTITUDE(data) => {
                self.attitude_angles = Some((now_s, ()));
                let [roll, pitch, yaw] = [data.roll, data.pitch, data.yaw].map(f64::from);
                if [roll, pitch, yaw].iter().all(|angle| angle.is_finite()) {
                    let attitude = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
                    self.take_attitude(boot(data.time_boot_ms), attitude, now_s, inputs);
                }
            }
            MavMessage::ATTITUDE_QUATERNION(data)
                if recent(self.attitude_angles, now_s, PREFER_S).is_none() =>
            {
                if let Some(attitude) = rotation([data.q1, data.q2, data.q3, data.q4]) {
                    self.take_attitude(boot(data.time_boot_ms), attitude, now_s, inputs);
                }
            }
            MavMessage::LOCAL_POSITION_NED(data) => {
                self.take_local_position(data, boot(data.time_boot_ms), now_s, inputs);
            }
            MavMessage::GLOBAL_POSITION_INT(data) => {
                self.take_global_position(data, boot(data.time_boot_ms), now_s, inputs);
            }
            MavMessage::ALTITUDE(data) => self.take_altitude(data, now_s, inputs),
            _ => {}
        }
    }

    fn take_attitude(
        &mut self,
        time_s: f64,
        attitude: UnitQuaternion<f64>,
        now_s: f64,
        inputs: &mut Vec<Input>,
    ) {
        self.attitude = Some((now_s, attitude));
        // A gimbal that falls silent still carries the camera.
        let is_cameras = match self.options.camera_mount {
            CameraMount::GimbalIfReported => self.gimbal.is_none(),
            CameraMount::Fixed => true,
            CameraMount::Gimbal(_) | CameraMount::Unknown => false,
        };
        if is_cameras {
            let aircraft = Attitude::looking_down(time_s, &attitude);
            inputs.push(Input::Attitude(self.options.fixed_mount.camera(aircraft)));
        }
    }

    /// Takes in what component `component_id` says of a gimbal. `own_time_s` is the time of it if that is on the autopilot's clock.
    pub fn take_gimbal(
        &mut self,
        component_id: u8,
        data: &GIMBAL_DEVICE_ATTITUDE_STATUS_DATA,
        own_time_s: Option<f64>,
        now_s: f64,
        inputs: &mut Vec<Input>,
    ) {
        let id = gimbal_id(component_id, data);
        let is_cameras = match self.options.camera_mount {
            CameraMount::GimbalIfReported => self.gimbal.is_none_or(|first| first == id),
            CameraMount::Gimbal(wanted) => wanted == id,
            CameraMount::Fixed | CameraMount::Unknown => false,
        };
        let Some(gimbal) = rotation(data.q).filter(|_| is_cameras) else {
            return;
        };
        self.gimbal = Some(id);
        let time_s =
            own_time_s.unwrap_or_else(|| self.gimbal_clock.time_s(data.time_boot_ms, now_s));
        let to_north = if is_relative_to_north(data.flags) {
            UnitQuaternion::identity()
        } else {
            let Some(vehicle) = recent(self.attitude, now_s, HOLD_S) else {
                return;
            };
            UnitQuaternion::from_euler_angles(0.0, 0.0, vehicle.euler_angles().2)
        };
        let attitude: Attitude = Attitude::of_camera(time_s, &(to_north * gimbal));
        inputs.push(Input::Attitude(attitude));
    }

    fn take_local_position(
        &mut self,
        data: &LOCAL_POSITION_NED_DATA,
        time_s: f64,
        now_s: f64,
        inputs: &mut Vec<Input>,
    ) {
        let [down_m, north, east, down] = [data.z, data.vx, data.vy, data.vz].map(f64::from);
        if [down_m, north, east, down]
            .iter()
            .all(|value| value.is_finite())
        {
            self.local = Some((now_s, (down_m, down)));
            self.take_velocity(time_s, east, north, inputs);
        }
    }

    fn take_global_position(
        &mut self,
        data: &GLOBAL_POSITION_INT_DATA,
        time_s: f64,
        now_s: f64,
        inputs: &mut Vec<Input>,
    ) {
        // Without a position, ArduPilot states 0 or a height above where it started.
        let has_amsl = data.alt != 0 && (data.lat, data.lon) != (0, 0);
        let amsl_m = has_amsl.then(|| f64::from(data.alt) * 1e-3);
        let relative_m = f64::from(data.relative_alt) * 1e-3;
        self.amsl_m = amsl_m.map(|amsl_m| (now_s, amsl_m)).or(self.amsl_m);
        self.relative_m = Some((now_s, relative_m));
        // Where the rangefinder no longer reaches the ground, heights above home go on from its last one for a while: a step is no climb,
        // and the ground last seen is nearer than home.
        let agl_m = recent(self.home_above_ground_m, now_s, GROUND_HOLD_S)
            .map(|home_above_ground_m| relative_m + home_above_ground_m)
            .filter(|agl_m| HEIGHT_AGL_RANGE_M.contains(agl_m))
            .unwrap_or(relative_m);
        if HEIGHT_AGL_RANGE_M.contains(&agl_m)
            && recent(self.above_ground, now_s, PREFER_S).is_none()
        {
            inputs.push(Input::Height(Height {
                time_s,
                agl_m,
                amsl_m,
            }));
        }
        if self.vouches_for_velocity(data) && recent(self.local, now_s, PREFER_S).is_none() {
            let (north, east) = (f64::from(data.vx) * 1e-2, f64::from(data.vy) * 1e-2);
            self.take_velocity(time_s, east, north, inputs);
        }
    }

    /// Whether the velocity in GLOBAL_POSITION_INT is one that the autopilot knows.
    ///
    /// ArduPilot and PX4 send LOCAL_POSITION_NED only while they know the velocity, and go on with GLOBAL_POSITION_INT without it:
    /// then the velocity in it is about 0 however fast the aircraft flies.
    fn vouches_for_velocity(&self, data: &GLOBAL_POSITION_INT_DATA) -> bool {
        // All zero is what other autopilots send that do not know their velocity.
        self.kind == AutopilotKind::Other && [data.vx, data.vy, data.vz] != [0; 3]
    }

    /// ALTITUDE has no time since the start that all autopilots agree on; heights change slowly.
    fn take_altitude(&mut self, data: &ALTITUDE_DATA, now_s: f64, inputs: &mut Vec<Input>) {
        let agl_m = f64::from(data.bottom_clearance);
        if HEIGHT_AGL_RANGE_M.contains(&agl_m) {
            self.above_ground = Some((now_s, ()));
            if let Some(relative_m) = recent(self.relative_m, now_s, HOLD_S) {
                self.home_above_ground_m = Some((now_s, agl_m - relative_m));
            }
            let amsl_m = Some(f64::from(data.altitude_amsl)).filter(|value| value.is_finite());
            inputs.push(Input::Height(Height {
                time_s: now_s,
                agl_m,
                amsl_m,
            }));
        }
    }

    fn take_velocity(&self, time_s: f64, east: f64, north: f64, inputs: &mut Vec<Input>) {
        if let Some(sigma_m_s) = self.options.velocity_sigma_m_s {
            inputs.push(Input::Velocity(Velocity {
                time_s,
                east_m_s: east,
                north_m_s: north,
                sigma_m_s,
            }));
        }
    }
}

/// A rotation from w, x, y, z. `None` if it is none.
fn rotation(wxyz: [f32; 4]) -> Option<UnitQuaternion<f64>> {
    let [w, x, y, z] = wxyz.map(f64::from);
    UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.5)
        .filter(|q| q.coords.iter().all(|value| value.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The heights above ground of a flight whose height above home and, where the rangefinder reaches the ground, above ground come
    /// five times a second, metres.
    fn heights_agl_m(flown: &[(f64, Option<f64>)]) -> Vec<f64> {
        let mut telemetry = MavlinkTelemetry::new(TelemetryOptions::default(), AutopilotKind::Px4);
        let mut inputs = Vec::new();
        for (number, (relative_m, clearance_m)) in flown.iter().enumerate() {
            let now_s = 0.2 * number as f64;
            let messages = [
                MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
                    relative_alt: (relative_m * 1e3) as i32,
                    ..GLOBAL_POSITION_INT_DATA::default()
                }),
                MavMessage::ALTITUDE(ALTITUDE_DATA {
                    bottom_clearance: clearance_m
                        .map_or(f32::NAN, |clearance_m| clearance_m as f32),
                    ..ALTITUDE_DATA::default()
                }),
            ];
            for message in messages {
                telemetry.take(&message, now_s, &|_| now_s, &mut inputs);
            }
        }
        inputs
            .iter()
            .filter_map(|input| match input {
                Input::Height(height) => Some(height.agl_m),
                _ => None,
            })
            .collect()
    }

    #[test]
    fn heights_above_home_go_on_from_those_of_the_rangefinder() {
        // Over ground 40 m above home, from 5 s to 10 s beyond the range of the rangefinder, 0.2 m higher each time.
        let flown: Vec<(f64, Option<f64>)> = (0..50)
            .map(|number| {
                let agl_m = 60.0 + 0.2 * f64::from(number);
                (agl_m + 40.0, (number < 25).then_some(agl_m))
            })
            .collect();
        let heights_m = heights_agl_m(&flown);
        assert_eq!(heights_m[0], 100.0, "before the rangefinder");
        for (before_m, after_m) in heights_m[1..].iter().zip(&heights_m[2..]) {
            // A second passes before heights above home are taken.
            assert!((0.1..1.3).contains(&(after_m - before_m)), "{heights_m:?}");
        }
        assert!(
            (heights_m.last().unwrap() - 69.8).abs() < 1e-3,
            "{heights_m:?}"
        );
        assert!(heights_m.len() > 40);
    }

    #[test]
    fn ground_that_a_rangefinder_measured_long_ago_or_that_cannot_be_is_not_used() {
        let hover = |clearance_m| std::iter::repeat_n((80.0, clearance_m), 5);
        let beyond_range = std::iter::repeat_n((80.0, None), 200);
        let heights_m = heights_agl_m(&Vec::from_iter(hover(Some(60.0)).chain(beyond_range)));
        assert_eq!(heights_m[heights_m.len() / 2], 60.0);
        assert_eq!(*heights_m.last().unwrap(), 80.0);
        // Over a roof, and then lower than it is.
        let low = std::iter::repeat_n((15.0, None), 20);
        let heights_m = heights_agl_m(&Vec::from_iter(hover(Some(60.0)).chain(low)));
        assert_eq!(*heights_m.last().unwrap(), 15.0);
    }

    #[test]
    fn what_is_no_rotation_is_none() {
        assert!(rotation([0.0, 2.0, 0.0, 0.0]).is_some());
        for value in [f32::NAN, f32::INFINITY, 0.0] {
            assert!(rotation([0.0, value, 0.0, 0.0]).is_none(), "{value}");
        }
    }

    #[test]
    fn without_a_rangefinder_heights_are_above_home() {
        assert_eq!(
            heights_agl_m(&[(80.0, None), (0.5, None), (81.0, None)]),
            [80.0, 81.0]
        );
    }
}
