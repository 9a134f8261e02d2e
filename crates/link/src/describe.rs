//! Messages in words, for those who want to see what would be sent.

use mavlink::dialects::common::{MavCmd, MavMessage};

/// A line for messages that carry positions or change the autopilot; none for heartbeats and requests.
#[allow(deprecated, reason = "SET_GPS_GLOBAL_ORIGIN is what autopilots read")]
pub(crate) fn describe(message: &MavMessage) -> Option<String> {
    let degrees = |value: i32| f64::from(value) * 1e-7;
    Some(match message {
        MavMessage::ODOMETRY(data) if data.quality < 0 => {
            format!("ODOMETRY without a position, quality {}", data.quality)
        }
        MavMessage::ODOMETRY(data) => format!(
            "ODOMETRY x {:.2} y {:.2} z {:.2} m, {:?}, variance {:.2} {:.2} m2, quality {} %, reset_counter {}",
            data.x,
            data.y,
            data.z,
            data.frame_id,
            data.pose_covariance[0],
            data.pose_covariance[6],
            data.quality,
            data.reset_counter,
        ),
        MavMessage::GLOBAL_POSITION_SENSOR(data) => format!(
            "GLOBAL_POSITION_SENSOR {:.7} {:.7}, eph {:.2} m, id {}",
            degrees(data.lat),
            degrees(data.lon),
            data.eph,
            data.id,
        ),
        MavMessage::COMMAND_INT(data)
            if data.command == MavCmd::MAV_CMD_EXTERNAL_POSITION_ESTIMATE =>
        {
            format!(
                "MAV_CMD_EXTERNAL_POSITION_ESTIMATE {:.7} {:.7}, accuracy {:.2} m",
                degrees(data.x),
                degrees(data.y),
                data.param3,
            )
        }
        MavMessage::GPS_INPUT(data) => format!(
            "GPS_INPUT {:.7} {:.7}, north {:.2} east {:.2} m/s, horiz_accuracy {:.2} m",
            degrees(data.lat),
            degrees(data.lon),
            data.vn,
            data.ve,
            data.horiz_accuracy,
        ),
        MavMessage::SET_GPS_GLOBAL_ORIGIN(data) => format!(
            "SET_GPS_GLOBAL_ORIGIN {:.7} {:.7}",
            degrees(data.latitude),
            degrees(data.longitude),
        ),
        _ => return None,
    })
}
