//! What is asked of an autopilot: its version, telemetry at useful rates, the origin of its local frame, a parameter.

// The command that supersedes SET_GPS_GLOBAL_ORIGIN is not read by ArduPilot 4.6 and PX4 1.17.
#[allow(deprecated)]
use mavlink::dialects::common::SET_GPS_GLOBAL_ORIGIN_DATA;
use mavlink::{
    dialects::common::{
        COMMAND_LONG_DATA, MavCmd, MavMessage, PARAM_REQUEST_READ_DATA, SYSTEM_TIME_DATA,
    },
    types::CharArray,
};

use crate::{
    autopilot::Autopilot,
    every::Every,
    messages::{Position, deg_e7},
};

/// Telemetry that is asked for: message and hertz.
const STREAMS: [(u32, f64); 6] = [
    (ATTITUDE, 20.0),
    (GLOBAL_POSITION_INT, 5.0),
    (LOCAL_POSITION_NED, 10.0),
    (ALTITUDE, 2.0),
    (GIMBAL_DEVICE_ATTITUDE_STATUS, 20.0),
    (SYSTEM_TIME, 1.0),
];
const SYSTEM_TIME: u32 = 2;
const ATTITUDE: u32 = 30;
const LOCAL_POSITION_NED: u32 = 32;
const GLOBAL_POSITION_INT: u32 = 33;
const GPS_GLOBAL_ORIGIN: u32 = 49;
const ALTITUDE: u32 = 141;
const AUTOPILOT_VERSION: u32 = 148;
const GIMBAL_DEVICE_ATTITUDE_STATUS: u32 = 285;
/// An autopilot that answered so many requests for its origin without telling one has none. A request without an answer was lost.
const ORIGIN_ANSWERS: u32 = 5;

/// What is known, and so need not be asked.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    /// That no telemetry is wanted.
    pub without_telemetry: bool,
    pub origin: bool,
    /// The parameter [`QUALITY_PARAMETER`], or that it does not matter.
    pub quality_min: bool,
}

/// The parameter of ArduPilot below which quality positions do not go to its EKF.
pub(crate) const QUALITY_PARAMETER: &str = "VISO_QUAL_MIN";

/// Asks again until it is answered.
#[derive(Debug)]
pub(crate) struct Requests {
    streams: Every,
    version: Every,
    origin: Every,
    /// Whether an answer to a request for the origin is awaited.
    origin_awaited: bool,
    /// How many requests for the origin were answered without one.
    without_origin: u32,
    quality: Every,
}

impl Requests {
    pub fn new() -> Self {
        Self {
            streams: Every::seconds(30.0),
            version: Every::seconds(2.0),
            origin: Every::seconds(1.0),
            origin_awaited: false,
            without_origin: 0,
            quality: Every::seconds(5.0),
        }
    }

    /// Asks for everything at once.
    pub fn again(&mut self) {
        *self = Self::new();
    }

    /// Puts in `outbox` what is to be asked now.
    pub fn poll(
        &mut self,
        autopilot: &Autopilot,
        known: Known,
        now_s: f64,
        outbox: &mut Vec<MavMessage>,
    ) {
        if !known.without_telemetry && self.streams.is_due(now_s) {
            for (message, hertz) in STREAMS {
                let interval_us = 1e6 / hertz;
                outbox.push(command(
                    autopilot,
                    MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                    message,
                    interval_us as f32,
                ));
            }
        }
        let request = |message| command(autopilot, MavCmd::MAV_CMD_REQUEST_MESSAGE, message, 0.0);
        if autopilot.version.is_none() && self.version.is_due(now_s) {
            outbox.push(request(AUTOPILOT_VERSION));
        }
        if self.origin.is_due(now_s) {
            self.origin
                .set_seconds(if known.origin { 10.0 } else { 1.0 });
            self.origin_awaited = !known.origin;
            outbox.push(request(GPS_GLOBAL_ORIGIN));
        }
        if known.origin {
            self.without_origin = 0;
        }
        if !known.quality_min && self.quality.is_due(now_s) {
            outbox.push(MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                // By name.
                param_index: -1,
                target_system: autopilot.system_id,
                target_component: autopilot.component_id,
                param_id: CharArray::from(QUALITY_PARAMETER),
            }));
        }
    }

    /// Says that a request for a message was answered, whether it was granted or not.
    pub fn answered(&mut self) {
        if std::mem::take(&mut self.origin_awaited) {
            self.without_origin = self.without_origin.saturating_add(1);
        }
    }

    /// Tells an autopilot that has no origin, as it answered several times, that it is where the aircraft is. Gives whether it was
    /// told.
    #[allow(deprecated, reason = "see the import")]
    pub fn set_origin(
        &mut self,
        autopilot: &Autopilot,
        position: &Position,
        outbox: &mut Vec<MavMessage>,
    ) -> bool {
        if self.without_origin < ORIGIN_ANSWERS {
            return false;
        }
        self.without_origin = 0;
        let time_usec = (position.time_s * 1e6).round() as u64;
        outbox.push(MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
            time_unix_usec: time_usec,
            time_boot_ms: 0,
        }));
        let estimate = &position.estimate;
        let amsl_m = estimate.altitude_amsl_m.or(position.own.altitude_amsl_m);
        // The origin is on the ground below.
        let ground_amsl_m =
            amsl_m.unwrap_or(0.0) - amsl_m.and(estimate.height_agl_m).unwrap_or(0.0);
        outbox.push(MavMessage::SET_GPS_GLOBAL_ORIGIN(
            SET_GPS_GLOBAL_ORIGIN_DATA {
                latitude: deg_e7(estimate.lat_deg),
                longitude: deg_e7(estimate.lon_deg),
                altitude: (ground_amsl_m * 1e3).round() as i32,
                target_system: autopilot.system_id,
                time_usec,
            },
        ));
        true
    }
}

fn command(autopilot: &Autopilot, command: MavCmd, message: u32, param2: f32) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        // Numbers of messages are below 2^24, which a float holds exactly.
        param1: message as f32,
        param2,
        param3: 0.0,
        param4: 0.0,
        param5: 0.0,
        param6: 0.0,
        param7: 0.0,
        command,
        target_system: autopilot.system_id,
        target_component: autopilot.component_id,
        confirmation: 0,
    })
}
