//! Parameters of an autopilot.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use mavlink::{
    dialects::common::{MavMessage, MavParamType, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA},
    types::CharArray,
};

use crate::{
    autopilot::{Autopilot, AutopilotKind},
    connection::Connection,
    event::LinkEvent,
};

/// A parameter that was asked for so often without an answer does not exist.
const ROUNDS: usize = 4;
/// How long to wait for answers to a round.
const ROUND: Duration = Duration::from_millis(700);
const WAIT: Duration = Duration::from_millis(20);

/// Reads parameters by name. A name that is not in the result does not exist.
pub(crate) fn read_parameters(
    connection: &mut Connection,
    autopilot: &Autopilot,
    names: &[&str],
    events: &mut Vec<LinkEvent>,
) -> BTreeMap<String, f64> {
    let mut found = BTreeMap::new();
    for _ in 0..ROUNDS {
        let missing: Vec<&str> = names
            .iter()
            .copied()
            .filter(|name| !found.contains_key(*name))
            .collect();
        if missing.is_empty() {
            break;
        }
        for name in &missing {
            let request = MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
                // By name.
                param_index: -1,
                target_system: autopilot.system_id,
                target_component: autopilot.component_id,
                param_id: CharArray::from(*name),
            });
            connection.send(autopilot.system_id, &request, events);
        }
        let until = Instant::now() + ROUND;
        while Instant::now() < until && missing.iter().any(|name| !found.contains_key(*name)) {
            for (header, message) in connection.receive(WAIT, events) {
                if let MavMessage::PARAM_VALUE(data) = message
                    && autopilot.sent(&header)
                    && let Ok(name) = data.param_id.to_str()
                {
                    found.insert(name.to_owned(), value(&data, autopilot.kind));
                }
            }
        }
    }
    found
}

/// The value of a parameter. PX4 sends the bytes of an integer in the place of the float
/// (MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE), others its value.
fn value(data: &PARAM_VALUE_DATA, kind: AutopilotKind) -> f64 {
    let bits = data.param_value.to_bits();
    let [low, middle, ..] = bits.to_le_bytes();
    let short = [low, middle];
    match data.param_type {
        _ if kind != AutopilotKind::Px4 => f64::from(data.param_value),
        MavParamType::MAV_PARAM_TYPE_UINT8 => f64::from(low),
        MavParamType::MAV_PARAM_TYPE_INT8 => f64::from(low as i8),
        MavParamType::MAV_PARAM_TYPE_UINT16 => f64::from(u16::from_le_bytes(short)),
        MavParamType::MAV_PARAM_TYPE_INT16 => f64::from(i16::from_le_bytes(short)),
        MavParamType::MAV_PARAM_TYPE_UINT32 => f64::from(bits),
        MavParamType::MAV_PARAM_TYPE_INT32 => f64::from(bits as i32),
        _ => f64::from(data.param_value),
    }
}
