//! Messages that carry positions.

use grimnet_track::{Estimate, TrackState};
use mavlink::dialects::common::{
    COMMAND_INT_DATA, GLOBAL_POSITION_SENSOR_DATA, GPS_INPUT_DATA, GlobalPositionFlags,
    GlobalPositionSrc, GpsFixType, GpsInputIgnoreFlags, MavCmd, MavEstimatorType, MavFrame,
    ODOMETRY_DATA,
};
use nalgebra::{UnitQuaternion, Vector3};

use crate::{
    autopilot::{Autopilot, AutopilotKind},
    gate::sigma_m,
    gnss,
    projection::Projection,
};

/// The number of our GLOBAL_POSITION_SENSOR, which `EKF2_AGP0_ID` has to name.
pub(crate) const SENSOR_ID: u8 = 1;
/// Variance of the angles in ODOMETRY, square radians. They are the autopilot's own, so nothing may be concluded from them.
const ANGLE_VARIANCE: f32 = 1.0;
/// Variance of the height in ODOMETRY for PX4, square metres. It is the autopilot's own.
const HEIGHT_VARIANCE_M2: f32 = 25.0;
/// Variance of the position in an ODOMETRY that holds none, square metres: the most that ArduPilot assumes is 100 m.
const NO_POSITION_VARIANCE_M2: f32 = 1e4;
/// Error of the autopilot's own height, metres, 1 sigma, for GPS_INPUT.
const HEIGHT_SIGMA_M: f32 = 5.0;
/// The time in MAV_CMD_EXTERNAL_POSITION_ESTIMATE wraps here, seconds, as its definition asks: a float holds it to 10 us.
const WRAP_S: f64 = 250.0;

/// A position to be sent.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Position {
    /// Time of sending, for which the position holds, seconds on the link's clock.
    pub time_s: f64,
    pub state: TrackState,
    pub estimate: Estimate,
    pub own: OwnState,
}

/// What the autopilot said of itself.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct OwnState {
    /// From body (forward, right, down) to north-east-down.
    pub attitude: Option<UnitQuaternion<f64>>,
    /// Below the origin of the local frame, metres.
    pub down_m: Option<f64>,
    /// Metres per second downwards.
    pub velocity_down_m_s: Option<f64>,
    /// Above mean sea level, metres.
    pub altitude_amsl_m: Option<f64>,
}

impl Position {
    fn time_us(&self) -> u64 {
        microseconds(self.time_s)
    }

    fn altitude_amsl_m(&self) -> Option<f64> {
        self.own.altitude_amsl_m.or(self.estimate.altitude_amsl_m)
    }

    fn velocity_ned_m_s(&self) -> Vector3<f64> {
        Vector3::new(
            self.estimate.velocity_north_m_s,
            self.estimate.velocity_east_m_s,
            self.own.velocity_down_m_s.unwrap_or(0.0),
        )
    }

    /// ODOMETRY in the frame and with the covariance that the autopilot reads.
    pub fn odometry(
        &self,
        autopilot: &Autopilot,
        origin: &Projection,
        reset_counter: u8,
    ) -> ODOMETRY_DATA {
        let (north_m, east_m) = origin.north_east_m(self.estimate.lat_deg, self.estimate.lon_deg);
        let attitude = self.own.attitude.unwrap_or_else(|| {
            let heading_deg = self.estimate.heading_deg.unwrap_or(0.0);
            UnitQuaternion::from_euler_angles(0.0, 0.0, heading_deg.to_radians())
        });
        let velocity = attitude.inverse() * self.velocity_ned_m_s();
        let frame_id = match autopilot.kind {
            AutopilotKind::ArduPilot => MavFrame::MAV_FRAME_LOCAL_FRD,
            AutopilotKind::Px4 | AutopilotKind::Other => MavFrame::MAV_FRAME_LOCAL_NED,
        };
        let mut velocity_covariance = [0.0; 21];
        let velocity_variance = self.estimate.velocity_sigma_m_s.powi(2) as f32;
        for diagonal in [0, 6, 11] {
            velocity_covariance[diagonal] = velocity_variance;
        }
        ODOMETRY_DATA {
            time_usec: self.time_us(),
            x: north_m as f32,
            y: east_m as f32,
            z: self.own.down_m.unwrap_or(0.0) as f32,
            q: wxyz(&attitude),
            vx: velocity.x as f32,
            vy: velocity.y as f32,
            vz: velocity.z as f32,
            // Unknown: finite rates would say that this is the velocity of the body alone.
            rollspeed: f32::NAN,
            pitchspeed: f32::NAN,
            yawspeed: f32::NAN,
            pose_covariance: self.pose_covariance(autopilot),
            velocity_covariance,
            frame_id,
            child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
            reset_counter,
            estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
            quality: self.quality(),
        }
    }

    /// Percent, at least 1: 0 means unknown, -1 failed. Halved while there is no recent fix.
    fn quality(&self) -> i8 {
        let full = match self.state {
            TrackState::Tracking => 100.0,
            _ => 50.0,
        };
        (full * self.estimate.weight).round().clamp(1.0, 100.0) as i8
    }

    /// Upper triangle, row by row, of the covariance of x, y, z, roll, pitch, yaw.
    fn pose_covariance(&self, autopilot: &Autopilot) -> [f32; 21] {
        let mut covariance = [0.0; 21];
        for diagonal in [15, 18, 20] {
            covariance[diagonal] = ANGLE_VARIANCE;
        }
        if autopilot.kind == AutopilotKind::ArduPilot {
            let variance = ardupilot_variance(sigma_m(&self.estimate), autopilot) as f32;
            covariance[0] = variance;
            covariance[6] = variance;
        } else {
            let [ee, en, nn] = self.estimate.covariance_en_m2;
            covariance[0] = nn as f32;
            covariance[1] = en as f32;
            covariance[6] = ee as f32;
            covariance[11] = HEIGHT_VARIANCE_M2;
        }
        covariance
    }

    /// GLOBAL_POSITION_SENSOR. The position is extrapolated to the time of sending, so the processing time is 0.
    pub fn global_position_sensor(&self, autopilot: &Autopilot) -> GLOBAL_POSITION_SENSOR_DATA {
        GLOBAL_POSITION_SENSOR_DATA {
            time_usec: self.time_us(),
            processing_time: 0,
            lat: deg_e7(self.estimate.lat_deg),
            lon: deg_e7(self.estimate.lon_deg),
            alt_ellipsoid: f32::NAN,
            alt: self.altitude_amsl_m().unwrap_or(f64::NAN) as f32,
            eph: sigma_m(&self.estimate) as f32,
            epv: f32::NAN,
            target_system: autopilot.system_id,
            target_component: autopilot.component_id,
            id: SENSOR_ID,
            source: GlobalPositionSrc::GLOBAL_POSITION_SRC_VISION,
            flags: GlobalPositionFlags::empty(),
        }
    }

    /// MAV_CMD_EXTERNAL_POSITION_ESTIMATE. ArduPilot refuses it if the height is not NaN.
    pub fn position_estimate(&self, autopilot: &Autopilot) -> COMMAND_INT_DATA {
        COMMAND_INT_DATA {
            param1: self.time_s.rem_euclid(WRAP_S) as f32,
            param2: 0.0,
            param3: sigma_m(&self.estimate) as f32,
            param4: 0.0,
            x: deg_e7(self.estimate.lat_deg),
            y: deg_e7(self.estimate.lon_deg),
            z: f32::NAN,
            command: MavCmd::MAV_CMD_EXTERNAL_POSITION_ESTIMATE,
            target_system: autopilot.system_id,
            target_component: autopilot.component_id,
            frame: MavFrame::MAV_FRAME_GLOBAL,
            current: 0,
            autocontinue: 0,
        }
    }

    /// GPS_INPUT as GNSS receiver `gps_id`.
    ///
    /// The velocity is not to be fused (`EK3_SRC1_VELXY` 0), so its accuracy is marked as not stated: ArduPilot's `EK3_GPS_CHECK`
    /// refuses the receiver, position and all, where that is above 1 m/s.
    pub fn gps_input(&self, gps_id: u8) -> GPS_INPUT_DATA {
        let (week, in_week_ms) = gnss::gps_week(self.time_s);
        let sigma_m = sigma_m(&self.estimate);
        let hdop = gnss::hdop(sigma_m) as f32;
        let altitude = self.altitude_amsl_m();
        let mut ignore_flags = GpsInputIgnoreFlags::GPS_INPUT_IGNORE_FLAG_VEL_VERT
            | GpsInputIgnoreFlags::GPS_INPUT_IGNORE_FLAG_SPEED_ACCURACY;
        if altitude.is_none() {
            ignore_flags |= GpsInputIgnoreFlags::GPS_INPUT_IGNORE_FLAG_ALT;
        }
        GPS_INPUT_DATA {
            time_usec: self.time_us(),
            time_week_ms: in_week_ms,
            lat: deg_e7(self.estimate.lat_deg),
            lon: deg_e7(self.estimate.lon_deg),
            alt: altitude.unwrap_or(0.0) as f32,
            hdop,
            vdop: hdop,
            vn: self.estimate.velocity_north_m_s as f32,
            ve: self.estimate.velocity_east_m_s as f32,
            vd: 0.0,
            speed_accuracy: self.estimate.velocity_sigma_m_s as f32,
            horiz_accuracy: sigma_m as f32,
            vert_accuracy: HEIGHT_SIGMA_M,
            ignore_flags,
            time_week: week,
            gps_id,
            fix_type: GpsFixType::GPS_FIX_TYPE_3D_FIX,
            satellites_visible: gnss::SATELLITES,
            yaw: 0,
        }
    }
}

/// ODOMETRY that holds no position: with quality -1, ArduPilot notes that the source is there and gives its EKF nothing.
pub(crate) fn odometry_without_position(time_s: f64, own: &OwnState) -> ODOMETRY_DATA {
    let attitude = own.attitude.unwrap_or_default();
    let mut covariance = [0.0; 21];
    for diagonal in [0, 6, 11] {
        covariance[diagonal] = NO_POSITION_VARIANCE_M2;
    }
    for diagonal in [15, 18, 20] {
        covariance[diagonal] = ANGLE_VARIANCE;
    }
    ODOMETRY_DATA {
        time_usec: microseconds(time_s),
        x: 0.0,
        y: 0.0,
        z: own.down_m.unwrap_or(0.0) as f32,
        q: wxyz(&attitude),
        vx: 0.0,
        vy: 0.0,
        vz: 0.0,
        rollspeed: f32::NAN,
        pitchspeed: f32::NAN,
        yawspeed: f32::NAN,
        pose_covariance: covariance,
        velocity_covariance: covariance,
        frame_id: MavFrame::MAV_FRAME_LOCAL_FRD,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
        reset_counter: 0,
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
        quality: -1,
    }
}

fn wxyz(attitude: &UnitQuaternion<f64>) -> [f32; 4] {
    [attitude.w, attitude.i, attitude.j, attitude.k].map(|value| value as f32)
}

/// Microseconds. Saturates; a time before 1970 is 0.
fn microseconds(time_s: f64) -> u64 {
    (time_s * 1e6).round() as u64
}

/// What to write at 0 and 6 of the covariance, with 0 at 11, so that ArduPilot takes the position with `sigma_m`.
///
/// ArduPilot makes one number of three: since February 2026 (4.7) the square root of their sum, before that the cube root of
/// the sum of their squares.
fn ardupilot_variance(sigma_m: f64, autopilot: &Autopilot) -> f64 {
    match autopilot.version {
        Some(version) if !version.is_at_least(4, 7) => (0.5 * sigma_m.powi(3)).sqrt(),
        _ => 0.5 * sigma_m * sigma_m,
    }
}

/// Degrees in units of 1e-7, as MAVLink has them.
pub(crate) fn deg_e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::Version;

    #[test]
    fn ardupilot_reads_the_stated_sigma() {
        let mut autopilot = Autopilot {
            system_id: 1,
            component_id: 1,
            kind: AutopilotKind::ArduPilot,
            version: None,
        };
        for sigma in [0.5, 2.0, 30.0] {
            autopilot.version = Some(Version {
                major: 4,
                minor: 6,
                patch: 3,
            });
            let old = ardupilot_variance(sigma, &autopilot);
            assert!(((old * old + old * old).cbrt() - sigma).abs() < 1e-12);
            for version in [
                None,
                Some(Version {
                    major: 4,
                    minor: 7,
                    patch: 0,
                }),
            ] {
                autopilot.version = version;
                let new = ardupilot_variance(sigma, &autopilot);
                assert!(((new + new).sqrt() - sigma).abs() < 1e-12);
            }
        }
    }
}
